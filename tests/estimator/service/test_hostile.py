"""Wildcard, foreign, forged and replayed traffic: none accepted, each counted by its reason, no session changed by a bit."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bridge.config.enrolment import Enrolment
from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply, State
from estimator.service.enrolment_gate import STRANGER
from tests.estimator.served import BRIDGE, WARD, Served
from tests.estimator.service import hostile
from tests.estimator.service.hostile import (
    foreign,
    forged,
    lived,
    message,
    of_boot,
    played,
    state,
    twice_shuffled,
    wildcards,
)
from tests.estimator.stream import Stream, calibration

A, B = "chest", "back"
BOTH = {A: 1, B: 2}


@pytest.fixture(scope="module")
def streams() -> dict[str, Stream]:
    return {name: calibration(seed=seed, after=[Still(5.0)]) for name, seed in BOTH.items()}


@pytest.fixture
def served() -> Iterator[Served]:
    with Served(Enrolment(enrolled=(A, B))) as made:
        yield made


def hashes(served: Served) -> list[str]:
    return [state(served, name) for name in BOTH]


def counts(served: Served, *starts: str) -> dict[str, int]:
    return {label: n for label, n in served.service._count_all().items() if label.startswith(starts)}


def test_wide_keys_and_other_ids_and_forgeries_are_counted_and_change_nothing(
    served: Served, streams: dict[str, Stream]
) -> None:
    recorded, _ = lived(served, streams, boot=7)
    before, one = hashes(served), recorded[40]
    other = B if one.device == A else A
    assert played(served, [*wildcards(one), *foreign(one, other), *forged(one, np.random.default_rng(1))]) == 0
    assert hashes(served) == before
    assert counts(served, "sample messages refused", "messages refused") == {
        "sample messages refused, wildcard_key": 7,
        "sample messages refused, foreign_id": 2,
        STRANGER: 1,
        "sample messages refused, version": 2,
        "sample messages refused, malformed": 2,
        "sample messages refused, too_large": 1,
        "sample messages refused, non_finite": 1,
        "sample messages refused, range": 4,
        "sample messages refused, length": 1,
    }
    events = served.service._devices[one.device].session.sequence
    assert events.events.as_dict()["also from intruder"] == len(one)
    assert (events.events.as_dict()["sample number jump refused"], events.dropped.as_dict()["range"]) == (1, len(one))


def test_a_recording_shuffled_and_played_twice_to_devices_that_are_silent_changes_nothing(
    served: Served, streams: dict[str, Stream]
) -> None:
    recorded = lived(served, streams, boot=6)[0] + lived(served, streams, boot=7)[0]
    for _ in range(20):
        served.round(0.5)
    before = hashes(served)
    assert played(served, map(message, twice_shuffled(recorded, np.random.default_rng(2)))) == 0
    assert played(served, map(message, recorded)) == 0, "nor in its own order"
    assert hashes(served) == before
    for name in BOTH:
        n = 3 * len(streams[name])
        dropped = served.service._devices[name].session.sequence.dropped.as_dict()
        assert dropped == {"old_boot": n, "duplicate": n}


def test_a_recording_is_no_sign_of_life(served: Served, streams: dict[str, Stream]) -> None:
    recorded, _ = lived(served, {A: streams[A]}, boot=7)
    for batch in recorded[-40:]:
        assert played(served, [message(batch)]) == 0
        served.round(0.5)
    session = served.service._devices[A].session
    served.service.work()
    assert session.life.state is State.LOST
    assert float(session.life.reason[0].params["duration"].split()[0]) > 15


@pytest.mark.parametrize("boot", [7, 8], ids=["a boot that is known", "another boot"])
def test_one_whose_bridges_clock_was_set_back_is_not_lost(
    served: Served, streams: dict[str, Stream], boot: int
) -> None:
    served.service._presence.change(keys.build(WARD, "alive/bridge", bridge=BRIDGE), True)
    served.token(7, A, alive=True)
    recorded, _ = lived(served, {A: streams[A]}, boot=7)
    served.token(7, A, alive=boot == 7)
    served.token(boot, A, alive=True)
    session, states = served.service._devices[A].session, set[State]()
    for n, batch in enumerate(recorded[:40]):
        served.put(replace(of_boot(batch, boot), receive_time_ns=recorded[0].receive_time_ns - 10**12 + n))
        served.round(0.25)
        served.service.work()
        states.add(session.life.state)
        if session.life.state is State.UNKNOWN:
            assert session.life.reason == (Code.SAMPLES_OUTDATED(bridge=BRIDGE),)
    assert State.UNKNOWN in states
    assert State.LOST not in states
    assert session.boot == boot
    assert (session.life.state is State.UNKNOWN) is (boot == 7), "another boot is believed in the end"
    for _ in range(20):
        served.round(0.25)
    served.service.work()
    assert session.life.state is State.LOST, "now nothing comes"


def test_a_recording_from_before_a_restart_does_not_begin_its_boot(streams: dict[str, Stream]) -> None:
    with Served() as first:
        first.tell(hostile.introduced(A, 6))
        lived(first, {A: streams[A]}, boot=6)
        first.tell(hostile.introduced(A, 7))
        old, _ = lived(first, {A: streams[A]}, boot=7)
        with Served(store=first.store) as second:
            lived(second, {A: streams[A]}, boot=7)
            before = state(second, A)
            recorded = [hostile.of_boot(batch, 6) for batch in old]
            assert played(second, map(message, recorded)) == 0
            assert state(second, A) == before
            sequence = second.service._devices[A].session.sequence
            assert sequence.dropped.as_dict() == {"old_boot": len(streams[A])}


def test_a_command_that_is_played_again_does_nothing_and_is_counted(served: Served, streams: dict[str, Stream]) -> None:
    lived(served, streams, boot=7)
    key = keys.build(WARD, "rpc", device=A, verb="recalibrate")
    payload = codec.encode_command(Command("r1", "nurse", ""))

    def ask(payload: bytes) -> CommandReply:
        replies = list[bytes]()
        served.service._commands.ask(key, payload, replies.append)
        served.round()
        return codec.decode_reply(replies[0])

    first = ask(payload)
    assert first.accepted
    assert served.service._devices[A].session.cancel("nurse") is None
    before = hashes(served)
    assert [ask(payload) for _ in range(5)] == [first] * 5
    assert not ask(b"\xff").accepted
    assert hashes(served) == before
    served.round()
    assert counts(served, "commands") == {"commands repeated": 5, "commands refused, malformed": 1}
