"""LSL in tests: found on this machine only, in this process and in those it starts. Imported before anything of LSL."""

import os
import tempfile
import time
from pathlib import Path

import pylsl

#: settings of liblsl for processes that read them from a file, as LabRecorder does
CONFIG = Path(tempfile.mkdtemp(prefix="truerate-lsl-")) / "lsl_api.cfg"
CONFIG.write_text(
    "[multicast]\nAddressesOverride = {239.255.172.215}\nTTLOverride = 0\nInterfaces = {127.0.0.1}\n"
    "[ports]\nIPv6 = disable\n[log]\nlevel = -2\n",
    encoding="utf-8",
)
os.environ["LSLAPICFG"] = str(CONFIG)


def ahead_s() -> float:
    """Host time minus LSL's time, s; of a delayed reading the difference is too small."""
    return max(time.time() - float(pylsl.local_clock()) for _ in range(20))


def inlet(source_id: str, timeout_s: float = 30.0) -> pylsl.StreamInlet:
    """A reader of a stream, once it is there."""
    found = pylsl.resolve_byprop("source_id", source_id, timeout=timeout_s)
    assert found, f"no LSL stream {source_id}"
    opened = pylsl.StreamInlet(found[0], as_numpy=found[0].channel_format() != pylsl.cf_string)
    opened.open_stream(timeout_s)
    return opened


def heard(markers: pylsl.StreamInlet, marked: list[tuple[str, float]]) -> bool:
    """Add the markers that came: words and LSL time, s; whether there are any so far."""
    words, stamps = markers.pull_chunk()
    marked += [(one[0], stamp) for one, stamp in zip(words, stamps, strict=True)]
    return bool(marked)
