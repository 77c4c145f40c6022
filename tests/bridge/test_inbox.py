"""The queue between a bus and a reader that does not read."""

from bridge.bus.contract import Message
from bridge.bus.inbox import Inbox


def test_nothing_that_comes_leaves_nothing_behind() -> None:
    """Several subscriptions that are read together say every second that nothing came."""
    inbox = Inbox(10)
    inbox.put([Message("k", b"unread")])
    for _ in range(100):
        inbox.put([])
    assert len(inbox._came) == 1
    assert inbox.drain(5, 0.0) == [Message("k", b"unread")]
    assert inbox.waited_s == 0.0
