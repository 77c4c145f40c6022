"""What hangs up for an estimator that is killed: real processes, whose connections another process has, too."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from estimator.service import hang_up
from estimator.service.hang_up import HangUp

#: connects to a port, and to another that is no router's; has these connections kept open by somebody else as well
_PROGRAM = """
import os, socket, subprocess, sys, threading
from estimator.service.hang_up import HangUp
ports = [int(port) for port in sys.argv[1:]]
both = [socket.create_connection(("127.0.0.1", port)) for port in ports]
keeps = subprocess.Popen(["sleep", "120"], pass_fds=[one.fileno() for one in both])
hangs_up = HangUp([f"tcp/127.0.0.1:{ports[0]}"])
def serve():
    hangs_up.look()
    print(keeps.pid, hangs_up.pid, flush=True)
    while (said := sys.stdin.readline().strip()) not in {"", "end"}:
        if said == "close":
            hangs_up.close()
        print("done", flush=True)
serves = threading.Thread(target=serve)
serves.start()
serves.join()
sys.stdin.readline()
"""
_PATIENT_S = 20.0


class Program(NamedTuple):
    """The process, who hangs up for it, and the router's and the other's end of its connections."""

    process: subprocess.Popen[str]
    hangs_up: int
    router: socket.socket
    other: socket.socket


def _listening() -> socket.socket:
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(_PATIENT_S)
    return server


@contextmanager
def _program() -> Iterator[Program]:
    with _listening() as router, _listening() as other:
        ports = [str(server.getsockname()[1]) for server in (router, other)]
        process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *ports], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        keeps, hangs_up = map(int, process.stdout.readline().split())
        ends = [server.accept()[0] for server in (router, other)]
        try:
            yield Program(process, hangs_up, *ends)
        finally:
            process.kill()
            process.wait()
            os.kill(keeps, signal.SIGKILL)
            for thing in (*ends, process.stdin, process.stdout):
                assert thing is not None
                thing.close()


def _until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _PATIENT_S
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def _sockets(pid: int) -> int:
    try:
        return sum(path.readlink().name.startswith("socket:") for path in Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return 0


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _ignores(pid: int, number: int) -> bool:
    said = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    ignored = next(line.split()[1] for line in said.splitlines() if line.startswith("SigIgn:"))
    return bool(int(ignored, 16) >> (number - 1) & 1)


def _ended(connection: socket.socket, within_s: float) -> bool:
    connection.settimeout(within_s)
    try:
        return not connection.recv(1)
    except TimeoutError:
        return False


def test_connections_to_routers_end_with_a_killed_process_and_no_others() -> None:
    with _program() as program:
        program.process.kill()
        assert _ended(program.router, _PATIENT_S)  # though somebody else has it still
        assert not _ended(program.other, 0.5)
        _until(lambda: not _runs(program.hangs_up))


def _niceness(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[16])


def test_what_is_left_of_a_process_whose_thread_ended_lets_others_go_first() -> None:
    with _program() as program:
        before = _niceness(program.process.pid)
        assert program.process.stdin is not None
        program.process.stdin.write("end\n")  # of one that is killed there may be nothing left by then
        program.process.stdin.flush()
        _until(lambda: _niceness(program.process.pid) > before)
        assert _ended(program.router, _PATIENT_S)


_TWO = """
import socket, subprocess, sys
from estimator.service import hang_up
at, hang_up._LATER_S = ("127.0.0.1", int(sys.argv[1])), 3.0
data, control = both = socket.create_connection(at), socket.create_connection(at)
keeps = subprocess.Popen(["sleep", "120"], pass_fds=[one.fileno() for one in both])
hangs_up = hang_up.HangUp([f"tcp/{at[0]}:{at[1]}"], lambda: {control.getsockname()[1]})
hangs_up.look()
print(data.getsockname()[1], keeps.pid, hangs_up.pid, flush=True)
sys.stdin.readline()
"""
#: more than there is room for on the way, where nobody reads
_MUCH = 1 << 25


def test_first_those_end_by_which_others_are_told_and_no_router_waits_for_the_rest(server: socket.socket) -> None:
    with ExitStack() as stack:
        program = [sys.executable, "-c", _TWO, str(server.getsockname()[1])]
        process = stack.enter_context(
            subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        )
        stack.callback(process.kill)
        assert process.stdout is not None
        port, keeps, pid = map(int, process.stdout.readline().split())
        stack.callback(os.kill, keeps, signal.SIGKILL)
        ends = {peer[1]: stack.enter_context(end) for end, peer in (server.accept() for _ in range(2))}
        data, (control,) = ends.pop(port), ends.values()
        _until(lambda: _sockets(pid) == 3)
        process.kill()
        assert _ended(control, _PATIENT_S)
        assert not _ended(data, 0.1)
        data.settimeout(_PATIENT_S)
        data.sendall(bytes(_MUCH))
        assert _ended(data, _PATIENT_S)  # though somebody else has it still
        _until(lambda: not _runs(pid))


def test_it_outlives_what_ends_all_processes_of_a_service() -> None:
    with _program() as program:
        _until(lambda: _ignores(program.hangs_up, signal.SIGUSR2))  # it has begun
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1):
            os.kill(program.hangs_up, number)
        assert not _ended(program.router, 0.5)
        program.process.kill()
        assert _ended(program.router, _PATIENT_S)


def test_of_a_process_that_stops_in_good_order_nothing_is_cut_off() -> None:
    with _program() as program:
        assert program.process.stdin is not None
        assert program.process.stdout is not None
        program.process.stdin.write("close\n")
        program.process.stdin.flush()
        assert program.process.stdout.readline() == "done\n"
        assert not _runs(program.hangs_up)
        program.process.stdin.close()
        assert program.process.wait(_PATIENT_S) == 0
        assert not _ended(program.router, 0.5)


def test_a_process_that_hangs_keeps_its_connections() -> None:
    with _program() as program:
        program.process.send_signal(signal.SIGSTOP)
        assert not _ended(program.router, 0.5)
        program.process.send_signal(signal.SIGCONT)
        assert _runs(program.hangs_up)


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with _listening() as server:
        yield server


@pytest.fixture
def hangs_up(server: socket.socket) -> Iterator[HangUp]:
    hangs_up = HangUp([f"tls/localhost:{server.getsockname()[1]}?a=b"])
    yield hangs_up
    hangs_up.close()


def test_a_new_connection_is_its_own_too_and_one_that_was_closed_is_let_go(
    server: socket.socket, hangs_up: HangUp
) -> None:
    first = socket.create_connection(server.getsockname())
    hangs_up.look()
    pid = hangs_up.pid
    assert pid is not None
    _until(lambda: _sockets(pid) == 2)
    with socket.create_connection(server.getsockname()):
        hangs_up.look()
        _until(lambda: _sockets(pid) == 3)
        with server.accept()[0] as its_end:
            first.close()
            hangs_up.look()
            assert _ended(its_end, _PATIENT_S)
        _until(lambda: _sockets(pid) == 2)


def test_one_that_is_killed_is_begun_again_but_not_for_ever(hangs_up: HangUp, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(3):
        hangs_up.look()
        pid = hangs_up.pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        hangs_up.look()
    assert [record.levelname for record in caplog.records] == ["WARNING"] * 3
    assert "ended by itself (-9); given up" in caplog.text
    hangs_up.look()
    assert hangs_up.pid is None
    assert len(caplog.records) == 3


def test_where_there_are_no_such_locks_the_estimator_goes_on_without(
    hangs_up: HangUp, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(hang_up, "_ROBUST", 77)
    for _ in range(5):
        hangs_up.look()
    assert hangs_up.pid is None
    assert caplog.text.count("pthread_mutexattr_setrobust: Invalid argument") == 3


def test_whatever_fails_the_estimator_goes_on(
    hangs_up: HangUp, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(sys, "executable", None)
    for _ in range(5):
        hangs_up.look()
    assert hangs_up.pid is None
    assert len(caplog.records) == 3


def test_one_that_is_held_up_does_not_hold_up_the_end(hangs_up: HangUp) -> None:
    hangs_up.look()
    pid = hangs_up.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    hangs_up.close()
    assert not _runs(pid)


def test_it_ends_with_the_process_even_where_the_lock_does_not_tell(
    hangs_up: HangUp, server: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hang_up._Lock, "let_go", lambda _: None)
    with socket.create_connection(server.getsockname()):
        hangs_up.look()
        pid, line = hangs_up.pid, hangs_up._line
        assert pid is not None
        assert line is not None
        line.close()  # as the end of the process would
        _until(lambda: not _runs(pid))
    monkeypatch.undo()


def test_nothing_stays_behind(hangs_up: HangUp) -> None:
    files, threads = len(list(Path("/proc/self/fd").iterdir())), threading.active_count()
    for _ in range(2):
        hangs_up.look()
        hangs_up.close()
    assert (len(list(Path("/proc/self/fd").iterdir())), threading.active_count()) == (files, threads)
