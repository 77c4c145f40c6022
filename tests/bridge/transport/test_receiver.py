"""One thread receives for all, lives while there is anything to receive, and keeps no more than it may."""

import os
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.transport import receiver
from bridge.transport.receiver import RECEIVER, Kept, Receiver
from bridge.transport.tcp_port import TcpPort

PATIENCE_S = 5.0


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def receiving() -> int:
    """Its threads; those of earlier tests may end meanwhile."""
    return sum(thread.name == "network" for thread in threading.enumerate())


def test_its_thread_and_files_end_with_the_last() -> None:
    made, before = Receiver(), (receiving(), open_files())
    for _ in range(20):
        pairs = [socket.socketpair() for _ in range(3)]
        heard: list[bytes] = []
        for ours, theirs in pairs:
            ours.setblocking(False)
            made.add(ours.fileno(), lambda ours=ours, heard=heard: heard.append(ours.recv(10)))  # type: ignore[misc]
            theirs.send(b"x")
        until(lambda: len(heard) >= 3)  # noqa: B023
        assert receiving() == before[0] + 1
        for ours, theirs in pairs:
            made.remove(ours.fileno())
            made.remove(ours.fileno())
            ours.close()
            theirs.close()
    until(lambda: receiving() == before[0] and open_files() <= before[1])


def test_what_waits_is_bounded_and_a_wait_can_be_ended() -> None:
    kept: Kept[str] = Kept()
    assert kept.take(0.0) is None
    kept.put("half", receiver._MOST_BYTES // 2)
    room = [kept.full]
    kept.put("more", receiver._MOST_BYTES)
    room.append(kept.full)
    assert [kept.take(0.0), kept.take(1.0)] == ["half", "more"]
    assert [*room, kept.full] == [False, True, False]
    threading.Timer(0.05, kept.end).start()
    began = time.monotonic()
    assert kept.take(60.0) is None
    assert time.monotonic() - began < PATIENCE_S


def test_a_tcp_device_that_is_not_read_is_held_back_and_loses_nothing() -> None:
    sent = os.urandom(1 << 16) * 200
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = TcpPort(f"127.0.0.1:{server.getsockname()[1]}", 0)
        port.open()
        device, _ = server.accept()
        sending = threading.Thread(target=device.sendall, args=(sent,), daemon=True)
        sending.start()
        connection = port._connection
        assert connection is not None
        until(lambda: connection._paused)
        assert connection.kept._in < 2 * receiver._MOST_BYTES
        assert sending.is_alive(), "the device waits"
        got = bytearray()
        while len(got) < len(sent):
            got += port.read(PATIENCE_S).data
        sending.join()
        device.close()
        port.close()
    assert bytes(got) == sent


def test_who_takes_just_as_a_device_is_held_back_does_not_hold_it_back_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sent = os.urandom(1 << 16) * 40
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = TcpPort(f"127.0.0.1:{server.getsockname()[1]}", 0)
        port.open()
        device, _ = server.accept()
        connection, got, remove = port._connection, bytearray(), RECEIVER.remove
        assert connection is not None

        def remove_late(fd: int) -> None:
            """The reader has taken all there was, and more than once, before it is carried out."""
            while (chunk := connection.take(0.0)) is not None:
                got.extend(chunk.data)
            remove(fd)

        monkeypatch.setattr(RECEIVER, "remove", remove_late)
        sending = threading.Thread(target=device.sendall, args=(sent,), daemon=True)
        sending.start()
        until(lambda: bool(got))
        monkeypatch.undo()
        end = time.monotonic() + PATIENCE_S
        while len(got) < len(sent) and time.monotonic() < end:
            got += port.read(0.05).data
        if len(got) == len(sent):
            sending.join()
        device.close()
        port.close()
    assert bytes(got) == sent
