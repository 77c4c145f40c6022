"""Quotas: a device that floods the bus delays no other, and loses its own oldest messages, counted."""

from bridge.bus.contract import Message
from bridge.wire import keys
from estimator.service.quota import FLOODED, QUOTA, QUOTA_BYTES, ROUND, SHARE, SHARE_BYTES, Quotas
from tests.estimator.served import Served
from tests.estimator.stream import NAME, calibration


def message(key: str, n: int, size: int = 8) -> Message:
    return Message(key, n.to_bytes(size, "little"))


def number(one: Message) -> int:
    return int.from_bytes(one.payload, "little")


def rounds(quotas: Quotas) -> list[Message]:
    """All that waits, in the order of its rounds."""
    out = list[Message]()
    while len(quotas):
        out += quotas.round([])
    return out


def test_each_key_keeps_its_order_and_nothing_is_dropped_within_the_quota() -> None:
    dropped: list[tuple[str, int]] = []
    quotas = Quotas(lambda *what: dropped.append(what))
    sent = [message("ab"[n % 3 == 0], n) for n in range(QUOTA)]
    out = quotas.round(sent) + rounds(quotas)
    for key in "ab":
        assert [m for m in out if m.key == key] == [m for m in sent if m.key == key]
    assert dropped == []


def test_a_round_is_bounded_and_all_keys_have_their_turn() -> None:
    quotas = Quotas(lambda *_: None)
    keys_ = [f"d{n}" for n in range(200)]
    out = quotas.round([message(key, n) for n in range(SHARE) for key in keys_])
    assert len(out) <= ROUND + SHARE
    first = {m.key for m in out}
    second = {m.key for m in quotas.round([message(key, SHARE) for key in first])}
    assert not first & second, "those that waited come before those that had their turn"
    assert len(out) + len(second) * SHARE + len(rounds(quotas)) == 200 * SHARE + len(first)


def test_above_the_quota_the_oldest_are_dropped_and_counted() -> None:
    dropped = 0

    def drop(key: str, messages: int) -> None:
        nonlocal dropped
        assert key == "flood"
        dropped += messages

    quotas = Quotas(drop)
    sent = [message("flood", n) for n in range(3 * QUOTA)]
    out = quotas.round(sent) + rounds(quotas)
    assert dropped == 2 * QUOTA
    assert [number(m) for m in out] == list(range(2 * QUOTA, 3 * QUOTA))
    size = SHARE_BYTES
    quotas.round([message("flood", n, size) for n in range(2 * QUOTA_BYTES // size)])
    assert dropped == 2 * QUOTA + QUOTA_BYTES // size


def test_a_flood_is_counted_with_its_device_and_all_others_go_on() -> None:
    batches = calibration(seed=1).batches()
    with Served() as served:
        served.put(batches[0])
        served.round()
        key = keys.build("w", "raw", bridge="bridge", device=NAME)
        served.raw.messages += [Message(key, b"rubbish")] * (QUOTA + 100)
        served.round()
        assert served.service.counts.as_dict()[FLOODED] == 100
        assert served.service._devices[NAME].session.sequence.events.as_dict()[FLOODED] == 100
