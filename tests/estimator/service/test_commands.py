"""Commands between the bus and the service; the clock is `now`."""

from collections.abc import Callable

import pytest

from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply
from estimator.service.commands import Commands
from tests.sentences import codes, free

KEY = keys.build("w", "rpc", device="chest", verb="recalibrate")


class Desk:
    """Commands, and a service that does them when it `works`."""

    def __init__(self) -> None:
        self.commands = Commands()
        self.done: list[tuple[str, str]] = []

    def ask(self, request_id: str = "r1", key: str = KEY, payload: bytes | None = None) -> list[CommandReply]:
        """Replies, as they come."""
        replies = list[CommandReply]()
        asked = codec.encode_command(Command(request_id, "nurse", "")) if payload is None else payload
        self.commands.ask(key, asked, lambda reply: replies.append(codec.decode_reply(reply)))
        return replies

    def answer(self, request_id: str = "r1", key: str = KEY, payload: bytes | None = None) -> CommandReply:
        replies = self.ask(request_id, key, payload)
        self.work()
        (reply,) = replies
        return reply

    def work(self) -> None:
        self.commands.work(self._do)

    def _do(self, key: keys.Key, command: Command, answer: Callable[[CommandReply], None]) -> None:
        self.done.append((key.ids["verb"], command.request_id))
        answer(CommandReply(command.request_id, accepted=True, message=free(f"number {len(self.done)}")))


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    at = [100.0]
    monkeypatch.setattr("estimator.service.commands.time.monotonic", lambda: at[0])
    return at


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
    desk = Desk()
    reply = desk.answer(key=key, payload=payload)
    assert not reply.accepted
    assert codes(reply.message) == [Code.COMMAND_MALFORMED]
    assert desk.done == []


def test_a_command_that_waited_too_long_is_not_done(now: list[float]) -> None:
    desk = Desk()
    replies = desk.ask()
    now[0] += 1.5
    desk.work()
    assert not replies[0].accepted
    assert Code.ESTIMATOR_BUSY in codes(replies[0].message)
    assert desk.done == []
    assert desk.answer().accepted


def test_too_many_at_once_are_turned_away() -> None:
    desk = Desk()
    asked = [desk.ask(f"r{n}") for n in range(80)]
    assert [len(replies) for replies in asked] == 64 * [0] + 16 * [1]
    assert all(Code.TOO_MANY_COMMANDS in codes(replies[0].message) for replies in asked[64:])
    desk.work()
    assert all(replies[0].accepted for replies in asked[:64])
