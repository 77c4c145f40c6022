"""Hangs up for an estimator that is killed: others know of it some 20 to 60 ms sooner, and take over its devices.

Of a process that is killed the system first takes back the memory, and only then closes the connections, by which a router
notices. A second, small process has these connections, too, and waits for a lock that the system passes on as soon as the
thread that has it ends (a robust mutex: man pthread_mutexattr_setrobust).

This file is that process's program as well: it needs nothing but Python's own library.
"""

import contextlib
import ctypes
import errno
import logging
import mmap
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

log = logging.getLogger(__name__)

_SHARED, _ROBUST = 1, 1  # PTHREAD_PROCESS_SHARED, PTHREAD_MUTEX_ROBUST
#: more than a mutex and its attributes take on any machine
_MUTEX_BYTES, _ATTRIBUTES_BYTES = 256, 64
#: connections at most: two sessions, each to one of a few routers
_MOST = 16
#: the second process is begun so often at most
_TRIES = 3
_PORT = re.compile(r":(\d{1,5})(?:[?#].*)?\Z")


class HangUp:
    """For one thread, with whose end the process is taken for ended; routers: the endpoints that it is connected to."""

    def __init__(self, routers: Sequence[str]) -> None:
        self._ports = frozenset(int(port[1]) for endpoint in routers if (port := _PORT.search(endpoint)))
        self._lock: _Lock | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._line: socket.socket | None = None
        self._told: frozenset[int] = frozenset()
        self._tries = 0

    @property
    def pid(self) -> int | None:
        """The second process, where there is one."""
        return None if self._process is None else self._process.pid

    def look(self) -> None:
        """Once a second: see to it that the second process is there, and has the connections that there are now."""
        try:
            if self._process is not None and self._process.poll() is not None:
                raise ChildProcessError(f"its second process ended by itself ({self._process.returncode})")
            if self._process is None and self._tries < _TRIES:
                self._tries += 1
                self._begin()
            if self._line is not None:
                self._tell(self._line)
        except OSError as error:
            self.close()
            what = (
                "once more"
                if self._tries < _TRIES
                else "given up: if this estimator is killed, it is noticed 50 ms later"
            )
            log.warning("what hangs up for this estimator does not work: %s; %s", error, what)

    def close(self) -> None:
        """Leave the connections to us again; the second process ends."""
        if self._line is not None:
            self._line.close()
        if self._lock is not None:
            self._lock.let_go()
        if self._process is not None:
            self._process.wait()
        self._line = self._lock = self._process = None

    def _begin(self) -> None:
        memory = os.memfd_create("hang-up")
        self._line, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._told = frozenset()
        try:
            os.truncate(memory, _MUTEX_BYTES)
            lock = _Lock(memory)
            lock.make()
            lock.take()
            self._lock = lock
            self._process = subprocess.Popen(
                # Neither packages nor what the environment says: it is soon there, and small.
                [sys.executable, "-I", "-S", __file__, str(memory), str(its.fileno())],
                pass_fds=(memory, its.fileno()),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # a terminal's Ctrl-C is ours
            )
        finally:
            os.close(memory)
            its.close()

    def _tell(self, line: socket.socket) -> None:
        with contextlib.ExitStack() as stack:
            ours = {_inode(one): stack.enter_context(one) for one in _connections(self._ports)}
            if ours.keys() != self._told:
                some = [one.fileno() for one in ours.values()][:_MOST]
                socket.send_fds(line, [b"."], some, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
                self._told = frozenset(ours)


class _Lock:
    """A mutex in memory that processes share."""

    def __init__(self, memory: int) -> None:
        self._libc = ctypes.CDLL(None)
        self._memory = mmap.mmap(memory, _MUTEX_BYTES)
        self._at = ctypes.byref(ctypes.c_char.from_buffer(self._memory))

    def make(self) -> None:
        """Once, before anybody has it; raises OSError where there are no such locks."""
        attributes = ctypes.create_string_buffer(_ATTRIBUTES_BYTES)
        self._do("pthread_mutexattr_init", attributes)
        self._do("pthread_mutexattr_setpshared", attributes, _SHARED)
        self._do("pthread_mutexattr_setrobust", attributes, _ROBUST)
        self._do("pthread_mutex_init", self._at, attributes)

    def take(self) -> bool:
        """Wait until it is ours; whether who had it let go of it, and did not end."""
        error: int = self._libc.pthread_mutex_lock(self._at)
        return error != errno.EOWNERDEAD

    def let_go(self) -> None:
        """For the thread that has it."""
        self._libc.pthread_mutex_unlock(self._at)

    def _do(self, name: str, *arguments: object) -> None:
        if (function := getattr(self._libc, name, None)) is None:
            raise OSError(errno.ENOSYS, f"there is no {name}")
        if error := function(*arguments):
            raise OSError(error, f"{name}: {os.strerror(error)}")


def _connections(ports: frozenset[int]) -> list[socket.socket]:
    """Copies of this process's connections to these ports; they are to be closed."""
    found = list[socket.socket]()
    for path in Path("/proc/self/fd").iterdir():
        try:
            if not path.readlink().name.startswith("socket:"):
                continue
            copy = socket.socket(fileno=os.dup(int(path.name)))
        except OSError:  # closed meanwhile
            continue
        if _goes_to(copy, ports):
            found.append(copy)
        else:
            copy.close()
    return found


def _goes_to(one: socket.socket, ports: frozenset[int]) -> bool:
    if one.family not in {socket.AF_INET, socket.AF_INET6} or one.type != socket.SOCK_STREAM:
        return False
    try:
        return one.getpeername()[1] in ports
    except OSError:  # not connected
        return False


def _inode(one: socket.socket) -> int:
    return os.fstat(one.fileno()).st_ino


def _wait(memory: int, line: int) -> None:
    """The second process: have the connections of the first, and end them if its thread ends and has not said so before."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # who ends all processes of a service: it goes when the first one is gone
    held, lock = _Held(socket.socket(fileno=line)), _Lock(memory)
    threading.Thread(target=held.hear, daemon=True).start()
    if not lock.take():
        held.end()
    os._exit(0)


class _Held:
    """The connections that it was told of last."""

    def __init__(self, line: socket.socket) -> None:
        self._line, self._sockets = line, list[socket.socket]()

    def hear(self) -> None:
        """Until there is nobody who could say anything."""
        while (told := socket.recv_fds(self._line, 1, _MOST))[0]:
            before, self._sockets = self._sockets, [socket.socket(fileno=number) for number in told[1]]
            for one in before:
                one.close()

    def end(self) -> None:
        """Hang up: at the other end it is as if the process had ended."""
        for one in self._sockets:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)


if __name__ == "__main__":
    _wait(int(sys.argv[1]), int(sys.argv[2]))
