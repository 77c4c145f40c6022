"""Recordings: readers of many file formats, writers of MCAP, .npz, CSV and BIDS, the recorder of a ward, and recovery.

Public function: `load` reads one device's samples from any supported file, in SI units.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.recording.readers import MAX_BYTES, TICK_S, Reading, Recording, RecordingError, Told, load

__all__ = ["MAX_BYTES", "TICK_S", "Reading", "Recording", "RecordingError", "Told", "load"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from bridge.recording import readers  # noqa: PLC0415

    return getattr(readers, name)
