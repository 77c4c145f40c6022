"""Checks of the machine for `truerate doctor`: clock synchronisation, free disk space, folder of recordings."""

import ctypes
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile

from bridge.diagnose.finding import Finding, ok, trouble, warning

_UNSYNCHRONISED = 0x40  # STA_UNSYNC of adjtimex(2)
_LITTLE_BYTES, _NONE_BYTES = 2_000_000_000, 100_000_000


class _Timex(ctypes.Structure):
    """The beginning of struct timex, with room for the rest."""

    _fields_ = (
        ("modes", ctypes.c_int),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_char * 512),
    )


def clock_status() -> int | None:
    """Return the status bits STA_* of the kernel's clock, from adjtimex(2); None if not available."""
    timex = _Timex()
    try:
        told = ctypes.CDLL(None).adjtimex(ctypes.byref(timex))
    except (AttributeError, OSError):
        return None
    return int(timex.status) if told >= 0 else None


def clock(status: int | None) -> list[Finding]:
    """Check if the machine's clock is synchronised with another clock. Returns one finding.

    The times of recordings from different machines are comparable only if their clocks agree.
    status: result of `clock_status`.
    """
    if status is None:
        return [warning("clock", "its synchronisation is unknown", "see `timedatectl`")]
    if status & _UNSYNCHRONISED:
        return [
            warning("clock", "not synchronised with a time server", "sudo timedatectl set-ntp true, or install chrony")
        ]
    return [ok("clock", "synchronised")]


def disk(
    places: dict[str, Path], free: Callable[[Path], int] = lambda path: shutil.disk_usage(path).free
) -> list[Finding]:
    """Check if each folder is writable and has free space. Returns one finding per folder.

    places: folders by purpose, in words. free: returns the free bytes of the disk that holds a path.
    Less than 2 GB free is a warning; less than 100 MB is trouble.
    """
    return [_room(what, folder.absolute(), free) for what, folder in places.items()]


def recordings(folder: Path) -> list[Finding]:
    """Check if the folder for recordings exists, because the recorder does not create it. Returns [] if it exists.

    A relative folder is not checked, because it depends on where the recorder is started.
    """
    if not folder.is_absolute() or os.path.exists(folder):  # noqa: PTH110
        return []
    return [
        warning(
            "recordings", f"{folder} does not exist; the recorder does not create this folder", f"mkdir -p {folder}"
        )
    ]


def _room(what: str, folder: Path, free: Callable[[Path], int]) -> Finding:
    check = f"disk, {what}"
    # Path.exists raises an error where access is denied.
    there = next(path for path in (folder, *folder.parents) if os.path.exists(path))  # noqa: PTH110
    if not there.is_dir():
        return trouble(check, f"{there} is a file, not a folder", "choose another folder in the ward file")
    try:
        TemporaryFile(dir=there).close()  # tells more than the permissions do, and leaves nothing
    except OSError as error:
        do = f"sudo install -d -o $USER {folder}, or choose another folder in the ward file"
        return trouble(check, f"{there} cannot be written to: {error.strerror}", do)
    bytes_free = free(there)
    said = f"{there}: {bytes_free / 1e9:.1f} GB free"
    if bytes_free < _NONE_BYTES:
        return trouble(check, said, "free disk space, or choose another folder")
    if bytes_free < _LITTLE_BYTES:
        return warning(check, said, "free disk space soon, or choose another folder")
    return ok(check, said)
