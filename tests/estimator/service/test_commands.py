"""Commands between the bus and the service; the clock is `now`."""

import pytest

from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply
from tests.estimator.memory_ward import Ward
from tests.sentences import codes

KEY = keys.build("w", "rpc", device="chest", verb="recalibrate")


def ask(ward: Ward, request_id: str = "r1", key: str = KEY, payload: bytes | None = None) -> list[CommandReply]:
    """Replies, as they come."""
    replies = list[CommandReply]()
    asked = codec.encode_command(Command(request_id, "nurse", "")) if payload is None else payload
    ward.service._commands.ask(key, asked, lambda reply: replies.append(codec.decode_reply(reply)))
    return replies


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
def test_what_is_no_command_is_answered_with_the_reason(ward: Ward, key: str, payload: bytes) -> None:
    replies = ask(ward, key=key, payload=payload)
    ward.service._commands.work()
    assert codes(replies[0].message) == [Code.COMMAND_MALFORMED]


def test_a_command_that_waited_too_long_is_not_done(ward: Ward, now: list[float]) -> None:
    replies = ask(ward)
    now[0] += 1.5
    ward.service._commands.work()
    assert codes(replies[0].message) == [Code.ESTIMATOR_BUSY]
    replies = ask(ward)
    ward.service._commands.work()
    assert Code.UNKNOWN_DEVICE in codes(replies[0].message)


def test_too_many_at_once_are_turned_away(ward: Ward) -> None:
    asked = [ask(ward, f"r{n}") for n in range(80)]
    assert [len(replies) for replies in asked] == 64 * [0] + 16 * [1]
    assert all(Code.TOO_MANY_COMMANDS in codes(replies[0].message) for replies in asked[64:])
    ward.service._commands.work()
    assert all(len(replies) == 1 for replies in asked)
