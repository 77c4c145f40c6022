"""The queue between a bus and a reader that does not read."""

from bridge.bus.contract import Message
from bridge.bus.message_queue import MessageQueue


def test_one_that_is_full_drops_its_oldest_and_counts_them() -> None:
    inbox = MessageQueue(100)
    for n in range(300):
        inbox.put([Message(f"k{n % 2}", str(n).encode())])
    assert [int(payload) for _, payload in inbox.drain(300, 0.0)] == list(range(200, 300))
    assert inbox.missed == inbox.overflowed == 200
    assert inbox.missed_by_key == {"k0": 100, "k1": 100}


def test_the_past_has_room_of_its_own_until_it_is_read() -> None:
    inbox = MessageQueue(10)
    inbox.put([Message("k", b"past")] * 20, past=True)
    inbox.put([Message("k", b"now")] * 10)
    assert inbox.missed == 0
    assert len(inbox.drain(100, 0.0)) == 30
    inbox.put([Message("k", b"now")] * 11)
    assert inbox.missed == 1
