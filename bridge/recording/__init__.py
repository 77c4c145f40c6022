"""Recordings: readers and writers of files, the recorder of a ward, recovery, surveys and exports.

`load` reads a file of any kind as a Recording. Names are looked up late: who only records does not wait for NumPy.
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
