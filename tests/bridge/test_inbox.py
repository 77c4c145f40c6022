"""The queue between a bus and a reader that does not read."""

from bridge.bus.contract import Message
from bridge.bus.inbox import KEPT, LARGE, Inbox


def test_nothing_that_comes_leaves_nothing_behind() -> None:
    """Several subscriptions that are read together say every second that nothing came."""
    inbox = Inbox(10)
    inbox.put([Message("k", b"unread")])
    for _ in range(100):
        inbox.put([])
    assert len(inbox._came) == 1
    assert inbox.drain(5, 0.0) == [Message("k", b"unread")]
    assert inbox.waited_s == 0.0


def test_a_large_one_that_is_full_makes_room_in_one_piece() -> None:
    inbox = Inbox(LARGE)
    for n in range(3 * LARGE):
        inbox.put([Message(f"k{n % 100}", str(n).encode())])
    left = [int(payload) for _, payload in inbox.drain(LARGE, 0.0)]
    assert left == list(range(3 * LARGE - len(left), 3 * LARGE))
    assert KEPT * LARGE <= len(left) <= LARGE
    assert inbox.missed == inbox.overflowed == 3 * LARGE - len(left)


def test_of_a_past_that_there_is_no_room_for_all_that_fits_is_kept() -> None:
    inbox = Inbox(LARGE, all_past=False)
    inbox.put([Message("k", b"")] * (2 * LARGE), past=True)
    assert inbox.waiting == LARGE
    whole = Inbox(LARGE)
    whole.put([Message("k", b"past")] * (2 * LARGE), past=True)
    whole.put([Message("k", b"now")] * (LARGE + 1))
    assert whole.waiting == 3 * LARGE
