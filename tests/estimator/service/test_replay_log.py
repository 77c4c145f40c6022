"""The replay log: the last seconds of each device, and no more."""

from bridge.bus.contract import Message
from bridge.wire import keys
from estimator.service.replay_log import DEVICE_BYTES, REPLAY_BYTES, REPLAY_S, ReplayLog
from tests.estimator.stream import NAME

KEY = keys.build("w", "raw", bridge="bridge", device=NAME)


def test_the_log_keeps_the_last_seconds() -> None:
    log = ReplayLog()
    for n in range(100):
        log.add("ab"[n % 2], Message(KEY, bytes([n])), 0.5 * n)
    kept = log.of({"a"})["a"]
    assert [one.payload[0] for one in kept] == [n for n in range(0, 100, 2) if 0.5 * n >= 49.5 - REPLAY_S]
    assert log.devices() == {"a", "b"}


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
