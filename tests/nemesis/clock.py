"""Clocks of parts of the ward that can be set while they run, where libfaketime is installed (Debian: libfaketime)."""

import os
from pathlib import Path

#: where wall clocks only are faked, time.sleep says EINVAL (libfaketime 0.9.10, Python 3.11)
_SLEEP = "import threading, time\ntime.sleep = lambda seconds: threading.Event().wait(seconds) and None\n"
_PLACES = ("/usr/lib/*/faketime/libfaketimeMT.so.1", "/usr/lib/faketime/libfaketimeMT.so.1")


class Clock:
    """Wall clocks only: monotonic time goes on as it does."""

    def __init__(self, library: Path, folder: Path) -> None:
        self._library, self._folder = library, folder

    @classmethod
    def found(cls, folder: Path) -> "Clock | None":
        """None where the library is not."""
        found = [path for place in _PLACES for path in sorted(Path("/").glob(place[1:]))]
        return cls(found[0], folder) if found else None

    def environment(self, part: str) -> dict[str, str]:
        """What a part's process is started with."""
        self.set(part, 0.0)
        (self._folder / "sitecustomize.py").write_text(_SLEEP, encoding="ascii")
        return {
            "PYTHONPATH": os.pathsep.join([str(self._folder), *filter(None, [os.environ.get("PYTHONPATH")])]),
            "LD_PRELOAD": str(self._library),
            "FAKETIME_TIMESTAMP_FILE": str(self._file(part)),
            # s; without, the file is read whenever anything asks for the time, and half of both processors goes into that.
            "FAKETIME_CACHE_DURATION": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
            # Else whoever waits for Python's lock does not wait at all: where two threads work a third of it is left of either.
            "FAKETIME_FORCE_MONOTONIC_FIX": "0",
        }

    def set(self, part: str, ahead_s: float) -> None:
        """Within a second its clock is so far ahead of the truth."""
        fresh = self._file(part).with_suffix(".new")
        fresh.write_text(f"{ahead_s:+.3f}\n", encoding="ascii")
        fresh.replace(self._file(part))  # never read half written

    def _file(self, part: str) -> Path:
        return self._folder / f"{part}.clock"
