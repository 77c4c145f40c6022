"""Whose turn at a device is the later one."""

from hypothesis import given
from hypothesis import strategies as st

from bridge.wire.checks import MAX_EPOCH
from estimator.service.ownership import epoch_after

NOW_NS = st.integers(0, 2**62)
IDS = st.text("abcdefghij-_0123456789", min_size=1, max_size=32)


@given(st.integers(0, MAX_EPOCH - 2**17), st.integers(0, 2**61), IDS)
def test_a_turn_is_above_all_that_was_heard_of_whatever_the_clock_says(highest: int, now_ns: int, own: str) -> None:
    assert highest < epoch_after(highest, now_ns, own) <= MAX_EPOCH


@given(NOW_NS, IDS)
def test_who_begins_anew_and_has_heard_nothing_is_above_who_began_earlier(now_ns: int, own: str) -> None:
    earlier = epoch_after(0, now_ns, own)
    assert epoch_after(0, now_ns + 10_000_000, own) > earlier or earlier == MAX_EPOCH


def test_two_that_take_a_device_at_once_differ() -> None:
    assert len({epoch_after(5, 10**18, f"estimator-{number}") for number in range(64)}) == 64
