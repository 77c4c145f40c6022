"""Reader of one stream of an XDF file, as Lab Streaming Layer records it, by pyxdf (the extra `xdf`).

pyxdf synchronises the clocks, and removes the jitter from the times of a regular stream. Channels are recognised by
their labels and units, as the columns of a text table. Source: https://github.com/sccn/xdf/wiki/Specifications
"""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
from pyxdf import load_xdf

from bridge.recording.error import MAX_BYTES, RecordingError
from bridge.recording.formats.streams import choose
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.recording.text import reader
from bridge.recording.text.names import understood


def read(path: Path, reading: Reading) -> Table:
    """Read one stream of an XDF file as a Table, in SI units.

    `reading.device` names the stream if the file has several. Raises RecordingError for a damaged file, a file without
    a gyro stream, or if there are several streams and none is named.
    """
    packed = path.suffix.lower() != ".xdf"
    if packed:
        _check_unpacked(path)
    with gzip.open(path) if packed else path.open("rb") as file:
        streams, _ = load_xdf(file, verbose=False)
    numeric = [one for one in streams if _first(one["info"], "channel_format") != "string" and _channels(one) > 2]
    whole = [one for one in numeric if len(one["time_stamps"])]
    likely = [one for one in whole if reading.device is not None or _has_gyro(one)] or whole
    chosen = choose(path, _named(likely), reading.device, "streams")
    info, time = chosen["info"], np.asarray(chosen["time_stamps"], np.float64)
    numbers = np.column_stack([np.asarray(chosen["time_series"], np.float64), time - time[0]])
    names = [*_labels(chosen), "time (s)"]
    table = reader.read_columns(
        path, names, numbers, reading, rate_hz=float(_first(info, "nominal_srate") or 0), sensor=_about(info)
    )
    if len(whole) > len(likely):
        table.notes.insert(
            0, f"the stream {_first(info, 'name')} is read, because its channels have names of gyro axes"
        )
    return table


def _check_unpacked(path: Path) -> None:
    """Raise RecordingError if a compressed file is too large unpacked."""
    size = 0
    with gzip.open(path) as file:
        while more := len(file.read(1 << 20)):
            size += more
            if size > MAX_BYTES:
                raise RecordingError(
                    f"{path}: the file unpacks to more than the {MAX_BYTES} bytes that are allowed: split the file"
                )


def _named(streams: list[Any]) -> dict[str, Any]:
    """Return streams by name; streams of the same name by name and number."""
    names = [_first(one["info"], "name") for one in streams]
    return {
        name if names.count(name) == 1 else f"{name}-{one['info']['stream_id']}": one
        for name, one in zip(names, streams, strict=True)
    }


def _has_gyro(stream: Any) -> bool:
    kinds = [understood(label).kind for label in _labels(stream)]
    return kinds.count("gyro") > 2 or ("gyr" in _about(stream["info"]).lower() and kinds.count("axis") > 2)


def _about(info: Any) -> str:
    return f"{_first(info, 'name')} {_first(info, 'type')}"


def _channels(stream: Any) -> int:
    return int(_first(stream["info"], "channel_count") or 0)


def _labels(stream: Any) -> list[str]:
    """Return a name with a unit for each channel; channels without a label are numbered."""
    described = (_inner(_inner(stream["info"], "desc"), "channels") or {}).get("channel") or []
    labels = [f"channel {number}" for number in range(1, _channels(stream) + 1)]
    for at, channel in enumerate(described[: len(labels)]):
        label, unit = _first(channel, "label"), _first(channel, "unit")
        if label.lower() in {"x", "y", "z"}:
            label = f"{_first(channel, 'type')} {label}".strip()
        labels[at] = f"{label or labels[at]} ({unit})" if unit else label or labels[at]
    return labels


def _inner(of: Any, key: str) -> Any:
    return ((of or {}).get(key) or [None])[0]


def _first(of: Any, key: str) -> str:
    return str(_inner(of, key) or "")
