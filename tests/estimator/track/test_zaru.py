from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.stillness import Window
from estimator.track.bias_filter import BiasFilter, BiasState, Receipt
from estimator.track.zaru import Zaru, ZaruKnobs

Floats = NDArray[np.float64]
BIAS = np.radians([1.0, -2.0, 0.5])
NAN = float("nan")


class Rest:
    """A device that rests, its windows made directly: 13 readings in 0.125 s."""

    def __init__(self, noise_dps: float = 0.03, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.noise = np.radians(noise_dps)
        self.time = 0.0
        self.zaru = Zaru()
        self.filter = BiasFilter(BiasState(BIAS, np.radians(0.005) ** 2 * np.eye(3), 0.0))

    def windows(self, seconds: float, offset: Floats | float = 0.0, *, still: bool = True) -> Iterator[Window]:
        for _ in range(round(seconds * 8)):
            mean = BIAS + offset + self.noise / np.sqrt(13) * self.rng.normal(size=3)
            std = np.full(3, self.noise)
            begin, self.time = self.time, self.time + 0.125
            yield Window(0, 13, begin, self.time, mean, std, np.full(3, 1e-7), None, None, still)

    def lives(self, seconds: float, offset_dps: float = 0.0, *, axis: int = 2, still: bool = True) -> list[Receipt]:
        offset = np.radians(offset_dps) * np.eye(3)[axis]
        found = [self.zaru.window(w, self.filter, NAN) for w in self.windows(seconds, offset, still=still)]
        return [receipt for receipt in found if receipt is not None]

    def error_dps(self) -> Floats:
        return np.degrees(self.filter.state.x - BIAS)


def test_rest_is_cut_into_pieces_of_a_second() -> None:
    rest = Rest()
    receipts = rest.lives(20.0)
    assert len(receipts) == 20
    assert all(r.accepted for r in receipts)
    assert receipts[0].time == pytest.approx(1.0)


def test_movement_breaks_a_piece_and_yields_nothing() -> None:
    rest = Rest()
    assert rest.lives(0.75) == []
    assert rest.lives(0.125, still=False) == []
    assert rest.lives(0.75) == []
    assert len(rest.lives(0.25)) == 1


def test_it_measures_the_mean_weighted_by_samples() -> None:
    rest = Rest()
    windows = list(rest.windows(1.0))
    windows[0] = replace(windows[0], end=130, mean=BIAS + 1e-4)
    for w in windows:
        receipt = rest.zaru.window(w, rest.filter, NAN)
    assert receipt is not None
    expected = (130 * windows[0].mean + 13 * np.sum([w.mean for w in windows[1:]], axis=0)) / (130 + 7 * 13)
    np.testing.assert_allclose(receipt.innovation, expected - BIAS)


def test_a_slow_drift_is_followed() -> None:
    rest = Rest()
    for step in range(60):
        assert all(r.accepted for r in rest.lives(5.0, 0.002 * step))
    np.testing.assert_allclose(rest.error_dps()[2], 0.118, atol=0.03)


@pytest.mark.parametrize("rate_dps", [0.1, 0.3, 0.5, 1.0, -1.4])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slow_real_turn_is_not_swallowed(rate_dps: float, axis: int) -> None:
    rest = Rest()
    rest.lives(30.0)
    receipts = rest.lives(60.0, rate_dps, axis=axis)
    assert not any(r.accepted for r in receipts)
    # Of the way turned nothing worth telling is lost.
    assert np.abs(rest.error_dps()).max() * 60 < 0.05 * abs(rate_dps) * 60 + 0.6
    assert all(r.accepted for r in rest.lives(10.0))


def test_a_contradiction_that_stays_is_believed_at_last() -> None:
    rest = Rest()
    rest.lives(30.0)
    receipts = rest.lives(ZaruKnobs().insist_s + 2.0, 0.5)
    first = next(r for r in receipts if r.accepted)
    assert first.reason == "insisted"
    assert first.time - 30.0 == pytest.approx(ZaruKnobs().insist_s, abs=1.1)
    np.testing.assert_allclose(rest.error_dps(), [0.0, 0.0, 0.5], atol=0.02)
    assert all(r.accepted for r in rest.lives(20.0, 0.5))


def test_two_contradictions_far_apart_are_not_one_that_stays() -> None:
    rest = Rest()
    assert not rest.lives(1.0, 0.5)[0].accepted
    assert all(r.accepted for r in rest.lives(ZaruKnobs().insist_s + 5.0))
    assert not rest.lives(1.0, 0.5)[0].accepted
    np.testing.assert_allclose(rest.error_dps(), 0.0, atol=0.02)


def test_contradictions_that_differ_are_not_one_that_stays() -> None:
    rest = Rest()
    for minute in range(8):
        assert not any(r.accepted for r in rest.lives(60.0, 1.0 if minute % 2 else -1.0))
    np.testing.assert_allclose(rest.error_dps(), 0.0, atol=0.02)


def test_movement_ends_an_insistence() -> None:
    rest = Rest()
    for _ in range(3):
        assert not any(r.accepted for r in rest.lives(ZaruKnobs().insist_s - 5.0, 0.5))
        rest.lives(0.5, still=False)


def test_readings_that_never_differ_are_no_perfect_measurement() -> None:
    rest = Rest()
    step = np.radians(0.061)
    for w in rest.windows(60.0):
        exact = replace(w, mean=step * np.round(BIAS / step), std=np.zeros(3), step=np.full(3, step))
        rest.zaru.window(exact, rest.filter, NAN)
    score = rest.error_dps() / np.degrees(rest.filter.state.std)
    assert np.abs(score).max() < 3.5


def test_a_noisier_rest_weighs_less() -> None:
    quiet, noisy = Rest(0.03), Rest(0.3)
    quiet.lives(30.0)
    noisy.lives(30.0)
    assert (noisy.filter.state.std > 1.2 * quiet.filter.state.std).all()
