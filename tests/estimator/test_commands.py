import threading
import time
from collections.abc import Callable
from typing import Self

import pytest

from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply
from estimator.service import commands
from estimator.service.commands import Commands

KEY = keys.build("w", "rpc", device="chest", verb="recalibrate")


class Worker:
    """Does as the service: works until told to stop."""

    def __init__(self, desk: Commands) -> None:
        self.done: list[tuple[str, str]] = []
        self._desk, self._stop = desk, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._stop.wait(0.002):
            self._desk.work(self.do)

    def do(self, key: keys.Key, command: Command, kept: Callable[[], None]) -> CommandReply:
        self.done.append((key.ids["verb"], command.request_id))
        kept()
        return CommandReply(command.request_id, accepted=True, message=f"number {len(self.done)}")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


def ask(desk: Commands, request_id: str = "r1", key: str = KEY) -> CommandReply:
    return codec.decode_reply(desk.ask(key, codec.encode_command(Command(request_id, "nurse", ""))))


def test_a_command_is_done_once_however_often_it_is_sent() -> None:
    desk = Commands()
    with Worker(desk) as worker:
        first, second, other = ask(desk), ask(desk), ask(desk, "r2")
    assert first == second == CommandReply("r1", accepted=True, message="number 1")
    assert other.message == "number 2"
    assert worker.done == [("recalibrate", "r1"), ("recalibrate", "r2")]


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        ("truerate/@v1/w/rpc/chest/explode", codec.encode_command(Command("r", "n", ""))),
        ("truerate/@v1/w/rpc/*/cancel", codec.encode_command(Command("r", "n", ""))),
        ("truerate/@v1/w/rpc/a b/cancel", codec.encode_command(Command("r", "n", ""))),
        (KEY, b""),
        (KEY, b"\xff\xff\xff"),
        (KEY, codec.encode_command(Command("", "n", ""))),
    ],
)
def test_what_is_no_command_is_answered_with_the_reason(key: str, payload: bytes) -> None:
    with Worker(Commands()) as worker:
        reply = codec.decode_reply(Commands().ask(key, payload))
    assert not reply.accepted
    assert len(reply.message) > 10
    assert worker.done == []


def test_it_is_answered_once_it_is_written_down() -> None:
    desk, writes = Commands(), list[Callable[[], None]]()

    def work(_key: keys.Key, command: Command, kept: Callable[[], None]) -> CommandReply:
        writes.append(kept)
        return CommandReply(command.request_id, accepted=True, message="done")

    replies: list[CommandReply] = []
    asking = [threading.Thread(target=lambda: replies.append(ask(desk))) for _ in range(2)]
    asking[0].start()
    while not writes:
        desk.work(work)
    asking[1].start()  # the same again
    until = time.monotonic() + 0.3
    while time.monotonic() < until:
        desk.work(work)
    assert replies == []
    writes[0]()
    for one in asking:
        one.join()
    assert replies == 2 * [CommandReply("r1", accepted=True, message="done")]
    assert len(writes) == 1


def test_too_many_at_once_are_turned_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "ANSWER_S", 1.0)
    desk = Commands()
    replies: list[CommandReply] = []

    def run(job: Callable[[], CommandReply]) -> None:
        replies.append(job())

    threads = [threading.Thread(target=run, args=(lambda n=n: ask(desk, f"r{n}"),)) for n in range(80)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sum("too many" in r.message for r in replies) == 80 - 64
    assert not any(r.accepted for r in replies)
