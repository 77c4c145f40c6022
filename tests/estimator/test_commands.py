import threading
import time
from collections.abc import Callable
from typing import Self

import pytest

from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply
from estimator.service import commands
from estimator.service.commands import Commands
from tests.sentences import codes, free

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
        return CommandReply(command.request_id, accepted=True, message=free(f"number {len(self.done)}"))

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
    assert first == second == CommandReply("r1", accepted=True, message=free("number 1"))
    assert other.message == free("number 2")
    assert worker.done == [("recalibrate", "r1"), ("recalibrate", "r2")]


def test_one_request_id_for_two_devices_or_verbs_is_two_requests() -> None:
    desk = Commands()
    with Worker(desk) as worker:
        for device, verb in (("chest", "recalibrate"), ("back", "recalibrate"), ("chest", "cancel")):
            ask(desk, "r1", keys.build("w", "rpc", device=device, verb=verb))
    assert len(worker.done) == 3


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
    assert codes(reply.message) == [Code.COMMAND_MALFORMED]
    assert worker.done == []


def test_a_service_that_does_not_come_is_not_waited_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "ANSWER_S", 0.05)
    desk = Commands()
    reply = ask(desk)
    assert not reply.accepted
    assert Code.ESTIMATOR_BUSY in codes(reply.message)
    assert Code.ESTIMATOR_BUSY in codes(reply.message)
    monkeypatch.undo()
    with Worker(desk) as worker:
        assert ask(desk, "r2").accepted
        assert worker.done == [("recalibrate", "r2")], "what was called too late is not done afterwards"
        assert ask(desk).accepted
    assert worker.done == [("recalibrate", "r2"), ("recalibrate", "r1")]


def test_what_was_begun_but_is_not_done_in_time_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "ANSWER_S", 0.2)
    monkeypatch.setattr(commands, "FINISH_S", 0.05)
    desk, over = Commands(), threading.Event()

    def slow(_key: keys.Key, command: Command, _kept: Callable[[], None]) -> CommandReply:
        over.wait(5)
        return CommandReply(command.request_id, accepted=True, message=free("done"))

    def serve() -> None:
        while not over.wait(0.005):
            desk.work(slow)

    worker = threading.Thread(target=serve)
    worker.start()
    reply = ask(desk)
    over.set()
    worker.join()
    assert not reply.accepted
    assert Code.OUTCOME_UNKNOWN in codes(reply.message)


def test_it_is_answered_once_it_is_written_down() -> None:
    desk, writes = Commands(), list[Callable[[], None]]()

    def work(_key: keys.Key, command: Command, kept: Callable[[], None]) -> CommandReply:
        writes.append(kept)
        return CommandReply(command.request_id, accepted=True, message=free("done"))

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
    assert replies == 2 * [CommandReply("r1", accepted=True, message=free("done"))]
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
    assert sum(Code.TOO_MANY_COMMANDS in codes(r.message) for r in replies) == 80 - 64
    assert not any(r.accepted for r in replies)


def test_answers_are_forgotten_oldest_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "_REMEMBERED", 3)
    desk = Commands()
    with Worker(desk) as worker:
        for n in range(5):
            ask(desk, f"r{n}")
        assert ask(desk, "r4").message == free("number 5")
        assert ask(desk, "r0").message == free("number 6")
    assert len(worker.done) == 6
