"""The backlog of a device that is taken over: nothing of it is lost, doubled or mixed, and it comes in few messages."""

from dataclasses import replace

import numpy as np

from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire.messages import SampleBatch
from estimator.service.replay_log import DEVICE_BYTES, MERGED, REPLAY_BYTES, REPLAY_S, ReplayLog, since
from tests.estimator.stream import NAME, calibration

KEY = keys.build("w", "raw", bridge="bridge", device=NAME)
BATCHES = calibration(seed=1).batches()[:200]


def message(batch: SampleBatch) -> Message:
    return Message(KEY, codec.encode_samples(batch))


def read(messages: list[Message]) -> list[SampleBatch]:
    return [codec.decode_samples(*one) for one in messages]


def test_a_backlog_has_the_same_samples_in_few_messages() -> None:
    sent = [message(batch) for batch in BATCHES]
    found = read(since(sent, BATCHES[0].boot, 0))
    assert max(map(len, found)) <= MERGED
    assert len(found) < len(sent) / 10
    for name in ("ticks", "gyro", "accel", "temperature_c", "flags"):
        mine, sent_ = (np.concatenate([getattr(batch, name) for batch in batches]) for batches in (found, BATCHES))
        np.testing.assert_array_equal(mine, sent_)
    assert [batch.sequence for batch in found] == list(np.cumsum([0, *map(len, found[:-1])]))


def test_it_begins_after_the_last_message_that_was_corrected() -> None:
    following = BATCHES[50].sequence
    assert read(since([message(batch) for batch in BATCHES], BATCHES[0].boot, following))[0].sequence == following
    assert read(since([message(batch) for batch in BATCHES], BATCHES[0].boot + 1, following))[0].sequence == 0


def test_what_a_second_bridge_repeats_late_takes_nothing_away() -> None:
    sent = [message(batch) for batch in BATCHES[:6]]
    late = Message(keys.build("w", "raw", bridge="other", device=NAME), sent[1].payload)
    found = read(since([*sent[:4], late, *sent[4:]], BATCHES[0].boot, BATCHES[2].sequence))
    assert [batch.sequence for batch in found] == [BATCHES[2].sequence]
    assert len(found[0]) == sum(map(len, BATCHES[2:6]))


def test_a_gap_another_boot_and_rubbish_are_left_as_they_came() -> None:
    again = [replace(batch, boot=BATCHES[0].boot + 1) for batch in BATCHES[:3]]
    rubbish = Message(KEY, b"\xff\xff")
    found = since([*map(message, [*BATCHES[:3], *BATCHES[4:6]]), rubbish, *map(message, again)], BATCHES[0].boot, 0)
    assert found[2] == rubbish
    boots = [(batch.boot, batch.sequence, len(batch)) for batch in read([*found[:2], *found[3:]])]
    n = [len(batch) for batch in BATCHES]
    assert boots == [
        (BATCHES[0].boot, 0, sum(n[:3])),
        (BATCHES[0].boot, sum(n[:4]), sum(n[4:6])),
        (BATCHES[0].boot + 1, 0, sum(n[:3])),
    ]


def test_a_device_that_floods_leaves_the_log_to_the_others() -> None:
    log = ReplayLog()
    log.add("calm", Message(KEY, b"calm"), 0.0)
    for _ in range(2 * REPLAY_BYTES // 2**20):
        log.add("flood", Message(KEY, bytes(2**20)), 1.0)
    assert log.of({"calm"})["calm"] == [Message(KEY, b"calm")]
    assert sum(len(one.payload) for one in log.of({"flood"})["flood"]) == DEVICE_BYTES
    log.tidy(REPLAY_S + 1.1)
    assert log.devices() == set()
    log.add("flood", Message(KEY, bytes(2**20)), REPLAY_S + 1.2)
    assert log.devices() == {"flood"}
