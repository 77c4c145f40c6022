"""Finds the processes that have a serial port open, from Linux's /proc, without opening the port."""

import contextlib
import os
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

PROC = Path("/proc")


class Holder(NamedTuple):
    """Process that has a port open: process id, and name as `ps` shows it."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})"


def holders(port: str, proc: Path = PROC) -> list[Holder]:
    """Return the processes that have a port open; root gets all of them, other users only their own.

    port: path of the port. proc: the /proc folder.
    """
    target = os.path.realpath(port)
    return [Holder(pid, _name(proc, pid)) for pid in _pids(proc) if target in _open_files(proc, pid)]


def locked(port: str, proc: Path = PROC) -> bool:
    """Return True if another process of any user has locked a serial port. Every bridge locks the ports that it reads.

    port: path of the port. proc: the /proc folder.
    """
    try:
        status = Path(port).stat()
        locks = (proc / "locks").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    # "1: FLOCK  ADVISORY  WRITE 1234 00:18:5 0 EOF": process, device in hexadecimal, inode in decimal
    place = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    held = [line.split() for line in locks.splitlines() if "FLOCK" in line]
    return any(place in words and str(os.getpid()) not in words for words in held)


def is_bridge(pid: int, proc: Path = PROC) -> bool:
    """Return True if process `pid` is `truerate bridge run` itself, not the shell or sudo that started it.

    proc: the /proc folder.
    """
    program, *words = command(pid, proc) or [""]
    return Path(program).name.startswith(("python", "truerate")) and ("bridge", "run") in pairwise(words)


def command(pid: int, proc: Path = PROC) -> list[str]:
    """Return the command line of process `pid` as a list of words; [] if the process has ended.

    proc: the /proc folder.
    """
    try:
        return (proc / str(pid) / "cmdline").read_text(errors="replace").rstrip("\0").split("\0")
    except OSError:
        return []


def _pids(proc: Path) -> list[int]:
    return sorted(int(entry.name) for entry in proc.iterdir() if entry.name.isdigit())


def _open_files(proc: Path, pid: int) -> Iterator[str]:
    with contextlib.suppress(OSError):  # another user's process, or ended meanwhile
        for entry in (proc / str(pid) / "fd").iterdir():
            with contextlib.suppress(OSError):
                yield str(entry.readlink())


def _name(proc: Path, pid: int) -> str:
    try:
        return (proc / str(pid) / "comm").read_text(errors="replace").strip()
    except OSError:
        return "?"
