"""Commands between the bus and the service; the clock is `now`."""

import pytest

from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply, State
from estimator.service.commands import REPEATED
from tests.estimator.database.faults import full_disk
from tests.estimator.memory_ward import WARD, Ward
from tests.estimator.stream import NAME, calibration, info
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


def answer(ward: Ward, request_id: str, verb: str) -> CommandReply:
    replies = ask(ward, request_id, keys.build(WARD, "rpc", device=NAME, verb=verb))
    ward.settle()
    return replies[0]


def test_a_command_that_is_played_again_does_nothing_even_if_it_was_refused(ward: Ward) -> None:
    refused = answer(ward, "r1", "recalibrate")
    assert Code.UNKNOWN_DEVICE in codes(refused.message)
    ward.send(calibration(seed=1).batches(), info(1))
    ward.settle()
    assert answer(ward, "r1", "recalibrate") == refused
    assert ward.latest().state is State.TRACKING
    assert answer(ward, "r2", "recalibrate").accepted


def test_a_command_is_done_once_however_often_it_comes_and_whatever_the_disk_does(ward: Ward) -> None:
    ward.send(calibration(seed=1).batches(), info(1))
    ward.settle()
    with full_disk():
        given = [answer(ward, f"r{n}", "zero-heading") for n in range(20)]
        assert [answer(ward, f"r{n}", "zero-heading") for n in range(20)] == given
    assert ward.service.counts.as_dict()[REPEATED] == 20
    answer(ward, "r1", "cancel")
    assert ward.service.counts.as_dict()[REPEATED] == 20, "another verb is another command"
