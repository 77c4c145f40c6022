import pytest

from estimator.same_rate import same_rate


@pytest.mark.parametrize(
    ("one_hz", "other_hz", "same"),
    [
        (104.0, 104.0, True),
        (104.0, 103.87341, True),  # as estimated in another boot
        (100.0, 102.0, True),
        (100.0, 102.1, False),
        (104.0, 52.0, False),
        (0.0, 0.0, True),
        (0.0, 104.0, False),
    ],
)
def test_rates_are_the_same_within_two_percent(one_hz: float, other_hz: float, *, same: bool) -> None:
    assert same_rate(one_hz, other_hz) is same_rate(other_hz, one_hz) is same
