"""Messages that were missed, by their streams."""

from bridge.bus.message_queue import MOST_KEYS, MessageQueue
from bridge.bus.missed_messages import describe_missed
from bridge.wire import keys


def key(what: str, device: str, **ids: str) -> str:
    return keys.build("w", what, device=device, **ids)


def test_the_streams_with_most_are_named() -> None:
    by_key = {
        key("status", "chest"): 9,
        key("raw", "wrist", bridge="b1"): 3,
        key("raw", "wrist", bridge="b2"): 2,
        key("corrected", "a"): 4,
        key("note", "b"): 1,
        key("note", "c"): 2,
        "": 5,
    }
    assert describe_missed(by_key) == (
        "26 messages missed on the bus: 9 status of chest, 5 raw of wrist, 4 corrected of a, 3 of 2 other streams, "
        "5 of streams that were new"
    )
    assert describe_missed({key("raw", "wrist", bridge="b1"): 1}) == "1 messages missed on the bus: 1 raw of wrist"
    assert describe_missed({}) == describe_missed({"": 0}) == ""


def test_what_is_counted_by_key_is_bounded_and_nothing_is_left_out() -> None:
    inbox = MessageQueue(1)
    for n in range(2 * MOST_KEYS):
        inbox.add_missed(2, f"t/{n}")
    assert len(inbox.missed_by_key) <= MOST_KEYS + 1
    assert sum(inbox.missed_by_key.values()) == inbox.missed == 4 * MOST_KEYS
