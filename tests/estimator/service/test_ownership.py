"""Whose device it is: the same to everyone, even, and little moves."""

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from estimator.service.membership import owner

IDS = st.text("abcdefghijklmnopqrstuvwxyz0123456789-_", min_size=1, max_size=32)
DEVICES = [f"bed-{number:03d}" for number in range(300)]


def test_it_is_known_once_and_for_all_so_that_versions_and_machines_agree() -> None:
    assert [owner(f"d{number}", ("e1", "e2", "e3")) for number in range(8)] == [
        *("e1", "e2", "e3", "e2", "e1", "e3", "e3", "e2"),
    ]


@given(st.sets(IDS, min_size=1, max_size=6), IDS)
def test_everyone_says_the_same_in_whatever_order_the_others_were_heard(estimators: set[str], device: str) -> None:
    said = {owner(device, order) for order in (sorted(estimators), sorted(estimators, reverse=True), estimators)}
    assert len(said) == 1
    assert said <= estimators


@given(st.sets(IDS, min_size=2, max_size=6), st.sets(IDS, max_size=50))
def test_of_one_that_goes_only_its_own_devices_move(estimators: set[str], devices: set[str]) -> None:
    gone = min(estimators)
    for device in devices:
        before, after = owner(device, estimators), owner(device, estimators - {gone})
        assert before in (after, gone)


def test_shares_are_as_uneven_as_chance_and_no_more() -> None:
    wards = [[f"w{ward}-{device}" for device in DEVICES] for ward in range(100)]
    shares = np.array(
        [list(Counter(owner(device, ("a", "b", "c")) for device in devices).values()) for devices in wards]
    )
    assert shares.sum(axis=1).tolist() == [300] * 100
    assert 7.0 < shares.std() < 9.5  # a multinomial's is 8.2
