"""Hangs up for an estimator that is killed: others know of it some 20 to 60 ms sooner, and take over its devices.

Of a process that is killed the system first takes back the memory, and only then closes the connections, by which a router
notices. A second, small process has these connections, too, and waits for a lock that the system passes on as soon as the
thread that has it ends (a robust mutex: man pthread_mutexattr_setrobust). What the killed one still has to do, 20 to 100 ms of a
processor for its memory, it lets wait for others that need the processor: where there are several estimators they do, just then.
A router has much to do, too: while it takes back hundreds of publishers nothing passes for 25 to 60 ms. So the connection over
which others are told that this estimator is gone ends first, and the others later.

This file is that process's program as well: it needs nothing but Python's own library.
"""

import contextlib
import ctypes
import errno
import logging
import mmap
import os
import re
import select
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

log = logging.getLogger(__name__)

_SHARED, _ROBUST = 1, 1  # PTHREAD_PROCESS_SHARED, PTHREAD_MUTEX_ROBUST
#: more than a mutex and its attributes take on any machine
_MUTEX_BYTES, _ATTRIBUTES_BYTES = 256, 64
#: connections at most: two sessions, each to one of a few routers
_MOST = 16
#: the second process is begun so often at most, unless it was there for so many looks
_TRIES, _LASTING = 3, 600
#: connections by which others are not told end so much later, s: most of what the killed one had is taken over by then
_LATER_S = 0.15
#: how often what still comes over those is taken away meanwhile, s, and bytes of it at a time
_TAKEN_S, _TAKEN_BYTES = 0.01, 1 << 18
#: it has so long to end, s, and its lock to tell that it should
_ENDS_S = 0.5
#: how far behind others a killed process stands, of 19: with a tenth of their share it is gone within a second on a busy machine
_BEHIND = 10
_PORT = re.compile(r":(\d{1,5})(?:[?#].*)?\Z")
_ONCE_MORE, _GIVEN_UP = "once more", "given up: if this estimator is killed, it is noticed some 50 ms later"


class HangUp:
    """For one thread, with whose end the process is taken for ended; routers: the endpoints that it is connected to.

    first: our ports of the connections by which others are told of that; where there is none all end at once.
    """

    def __init__(self, routers: Sequence[str], first: Callable[[], Collection[int]] = tuple) -> None:
        self._ports = frozenset(int(port[1]) for endpoint in routers if (port := _PORT.search(endpoint)))
        self._lock: _Lock | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._line: socket.socket | None = None
        self._first = first
        #: all sockets of this process when it was told of its connections, and the ports of the first
        self._told: tuple[frozenset[str], frozenset[int]] = frozenset(), frozenset()
        self._looks = 0
        alone = getattr(sys, "frozen", False) or not Path(__file__).is_file()
        self._tries = _TRIES if alone else 0  # there is no interpreter, or no file, to begin it with

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
                self._tries, self._looks = self._tries + 1, 0
                self._begin()
            if self._line is not None:
                self._tell(self._line)
                self._looks += 1
                if self._looks == _LASTING:
                    self._tries = 0
        except Exception as error:  # noqa: BLE001 - whatever it is, no device waits for it
            self.close()
            what = _ONCE_MORE if self._tries < _TRIES else _GIVEN_UP
            log.warning("what hangs up for this estimator does not work: %s; %s", error, what)

    def close(self) -> None:
        """Leave the connections to us again; the second process ends."""
        if self._line is not None:
            self._line.close()
        if self._lock is not None:
            self._lock.let_go()
        if self._process is not None:
            try:
                self._process.wait(_ENDS_S)
            except subprocess.TimeoutExpired:  # it is held up; to kill it does no harm
                self._process.kill()
                self._process.wait()
        self._line = self._lock = self._process = None

    def _begin(self) -> None:
        with tempfile.TemporaryFile(dir="/dev/shm", buffering=0) as memory:
            memory.truncate(_MUTEX_BYTES)
            lock = _Lock(memory.fileno())
            lock.make()
            lock.take()
            self._lock = lock
            self._line, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._told = frozenset(), frozenset()
            with its:
                passed = memory.fileno(), its.fileno()
                self._process = subprocess.Popen(
                    # Neither packages nor what the environment says: it is soon there, and small.
                    [sys.executable, "-I", "-S", __file__, *map(str, (*passed, os.getpid(), _LATER_S))],
                    pass_fds=passed,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,  # a terminal's Ctrl-C is ours
                )

    def _tell(self, line: socket.socket) -> None:
        there, first = _sockets(), frozenset(self._first())
        if (frozenset(there), first) == self._told:
            return
        with contextlib.ExitStack() as stack:
            copies = [stack.enter_context(copy) for number in there.values() if (copy := _copy(number)) is not None]
            ours = [copy for copy in copies if _goes_to(copy, self._ports)]
            ours.sort(key=lambda copy: copy.getsockname()[1] not in first)
            at_once = sum(copy.getsockname()[1] in first for copy in ours[:_MOST])
            # While they are under way ours is not the last hold on any: to close that may wait until all in it is sent.
            numbers = [copy.fileno() for copy in ours[:_MOST]]
            socket.send_fds(line, [bytes([at_once])], numbers, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        self._told = frozenset(there), first


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


def _sockets() -> dict[str, int]:
    """Sockets of this process, as the system calls them, and the number of each."""
    found = dict[str, int]()
    for path in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # closed meanwhile
            if (name := path.readlink().name).startswith("socket:"):
                found[name] = int(path.name)
    return found


def _copy(number: int) -> socket.socket | None:
    """Another hold on a socket; None where it was closed meanwhile, or the number is something else's."""
    try:
        copy = os.dup(number)
    except OSError:
        return None
    if not stat.S_ISSOCK(os.fstat(copy).st_mode):
        return None  # and stays open: to close a file takes its locks from whoever has them, a store say
    try:
        return socket.socket(fileno=copy)
    except OSError:
        os.close(copy)
        return None


def _goes_to(one: socket.socket, ports: frozenset[int]) -> bool:
    if one.family not in {socket.AF_INET, socket.AF_INET6} or one.type != socket.SOCK_STREAM:
        return False
    try:
        return one.getpeername()[1] in ports
    except OSError:  # not connected
        return False


def _wait(memory: int, line: int, pid: int, later_s: float) -> None:
    """The second process: have the connections of the first, and end them if its thread ends and has not said so before."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2):
        signal.signal(number, signal.SIG_IGN)  # to all processes of a service: this one goes when the first one is gone
    held, lock = _Held(socket.socket(fileno=line)), _Lock(memory)
    threading.Thread(target=held.hear, args=(later_s + _ENDS_S,), daemon=True).start()
    if not lock.take():
        later = held.end_first()
        _let_wait(pid)
        if later:
            _end_later(later, later_s)
    os._exit(0)


def _let_wait(pid: int) -> None:
    """What is left of the process that began this one stands behind others from now on."""
    if os.getppid() != pid:
        return  # it is gone, and its number may be another's
    with contextlib.suppress(OSError):  # it is gone
        for thread in Path(f"/proc/{pid}/task").iterdir():
            one = os.PRIO_PROCESS, int(thread.name)
            with contextlib.suppress(OSError):
                os.setpriority(*one, max(os.getpriority(*one), _BEHIND))


class _Held:
    """The connections that it was told of last."""

    def __init__(self, line: socket.socket) -> None:
        self._line, self._sockets, self._busy = line, list[socket.socket](), threading.Lock()
        #: so many of them end at once; 0: all
        self._first = 0

    def hear(self, ends_s: float) -> None:
        """Until there is nobody who could say anything: so long after that this process ends, whether or not its lock tells."""
        goes_on = True
        while goes_on:
            select.select([self._line], [], [])
            with self._busy:
                goes_on = self._take()
        time.sleep(ends_s)
        os._exit(0)

    def end_first(self) -> list[socket.socket]:
        """Hang up where it is to be at once; the connections that are left."""
        with self._busy:
            while select.select([self._line], [], [], 0.0)[0] and self._take():
                pass
            first = self._first or len(self._sockets)
            _end(self._sockets[:first])
            return self._sockets[first:]

    def _take(self) -> bool:
        """Have what it is told of next; whether there was anything."""
        said, theirs, _, _ = socket.recv_fds(self._line, 1, _MOST)
        if not said:
            return False
        self._first = said[0]
        before, self._sockets = self._sockets, [socket.socket(fileno=number) for number in theirs]
        # To close the last hold on a connection may take as long as what waits in it takes to be sent.
        threading.Thread(target=_let_go, args=(before,), daemon=True).start()
        return True


def _end(sockets: Sequence[socket.socket]) -> None:
    """Hang up: at the other end it is as if the process had ended."""
    for one in sockets:
        with contextlib.suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)


def _end_later(sockets: Sequence[socket.socket], after_s: float) -> None:
    """What comes until then is taken away: a router without room for it would wait, and all that it has to pass on with it."""
    end = time.monotonic() + after_s
    while (left := end - time.monotonic()) > 0:
        time.sleep(min(_TAKEN_S, left))
        for one in sockets:
            with contextlib.suppress(OSError):  # there is no more now
                while one.recv(_TAKEN_BYTES, socket.MSG_DONTWAIT):
                    pass
    _end(sockets)


def _let_go(sockets: Sequence[socket.socket]) -> None:
    for one in sockets:
        one.close()


if __name__ == "__main__":
    _memory, _line, _pid = map(int, sys.argv[1:4])
    _wait(_memory, _line, _pid, float(sys.argv[4]))
