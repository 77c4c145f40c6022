"""A pytest plugin: the tests run in a Python that lacks what Windows lacks, and says that it is on Windows.

Libraries are imported before, because they would look for Windows' own modules. What Python's own modules need stays.
"""

import asyncio
import getpass
import multiprocessing.pool
import multiprocessing.spawn
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import ModuleType

import h5py
import matplotlib.backends.backend_agg
import matplotlib.dates
import matplotlib.font_manager
import numba
import pyarrow.parquet
import pyxdf
import rich.live
import rosbags.highlevel
import rosbags.rosbag2
import scipy.optimize
import scipy.signal
import serial
import zenoh

LIBRARIES = [
    asyncio, getpass, h5py, matplotlib, multiprocessing, numba, pyarrow, pyxdf, rich, rosbags, scipy, serial, subprocess,
    tempfile, zenoh,
]  # fmt: skip
POSIX_ONLY = {
    "": "fcntl grp posix_ipc pty pwd readline resource syslog termios tty",
    "os": (
        "EX_OK O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_NONBLOCK chown eventfd fchmod fchown fork forkpty getegid geteuid getgid "
        "getgroups getloadavg getpgid getresuid getuid killpg lchown nice openpty pread pwrite sched_getaffinity "
        "sched_setaffinity set_blocking setsid sync sysconf ttyname"
    ),
    "select": "epoll poll",
    "signal": "SIGCHLD SIGHUP SIGKILL SIGPIPE SIGQUIT SIGUSR1 SIGUSR2 pthread_kill pthread_sigmask sigwait",
    "socket": "AF_UNIX",
    "time": "CLOCK_BOOTTIME CLOCK_MONOTONIC clock_gettime clock_gettime_ns clock_settime tzset",
}


class Missing(MetaPathFinder):
    """Finds no POSIX-only module."""

    def find_spec(self, name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None) -> None:
        """Raise ModuleNotFoundError for a POSIX-only module."""
        if name in POSIX_ONLY[""].split():
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def pretend() -> None:
    """Take away what Windows lacks."""
    ours = [name for name in sys.modules if name.split(".")[0] in {"bridge", "estimator", "truerate"}]
    assert not ours, f"already imported, with what Windows lacks: {ours}"
    for name in POSIX_ONLY[""].split():
        sys.modules.pop(name, None)
    sys.meta_path.insert(0, Missing())
    for module in (os, select, signal, sys.modules["socket"], sys.modules["time"]):
        for name in POSIX_ONLY[module.__name__].split():
            if hasattr(module, name):
                delattr(module, name)
    sys.platform = "win32"


pretend()
