"""The filter's own word against the truth it does not see: NEES of many simulated biases, in 99.9 % bands."""

import numpy as np
import pytest
from scipy.stats import chi2

from bridge.sim.imperfection import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.script import swing
from estimator.gyro import PriorKnobs
from estimator.session import DeviceSession, SessionKnobs
from estimator.stillness import Stillness
from estimator.track.bias_filter import BiasFilter, BiasKnobs, BiasState
from estimator.track.zaru import Zaru, ZaruKnobs
from tests.estimator.stream import NAME, Stream, calibration, feed, stream

NAN = float("nan")


def band(n: int) -> tuple[float, float]:
    """Where the mean of n NEES / 3 lies in 99.9 % of cases."""
    low, high = chi2.ppf([0.0005, 0.9995], 3 * n)
    return float(low) / (3 * n), float(high) / (3 * n)


def nees(state: BiasState, truth: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    error = state.x - truth
    return float(error @ np.linalg.solve(state.P, error)) / 3


@pytest.mark.parametrize("walk_factor", [0.5, 1.0, 2.0])
def test_on_a_random_walk_of_its_own_kind_it_is_consistent_and_on_another_it_is_not(walk_factor: float) -> None:
    """With rests every ten seconds or so. A wrong walk must show, or this test could not fail."""
    rng = np.random.default_rng(0)
    knobs = BiasKnobs()
    sigma = np.radians(0.005)
    found = []
    for _ in range(60):
        P0 = np.radians(0.01) ** 2 * np.eye(3)
        truth = np.radians(0.01) * rng.normal(size=3)
        bias = BiasFilter(BiasState(np.zeros(3), P0, 0.0), knobs)
        time = 0.0
        for _ in range(12):
            dt = rng.uniform(1.0, 20.0)
            time += dt
            truth = truth + walk_factor * knobs.rate_random_walk * np.sqrt(dt) * rng.normal(size=3)
            bias.predict(time)
            bias.update("zaru", truth + sigma * rng.normal(size=3), sigma**2 * np.eye(3))
        bias.predict(time + 30.0)
        truth = truth + walk_factor * knobs.rate_random_walk * np.sqrt(30.0) * rng.normal(size=3)
        found.append(nees(bias.state, truth))
    low, high = band(len(found))
    inside = low < float(np.mean(found)) < high
    assert inside is (walk_factor == 1.0), (np.mean(found), low, high)


def rested(of: Stream) -> BiasFilter:
    """Rests of a stream through recognition and evidence, as live."""
    stillness, zaru = Stillness(), Zaru()
    start = of.bias[0] + np.radians(0.005) * np.random.default_rng(len(of)).normal(size=3)
    bias = BiasFilter(BiasState(start, np.radians(0.005) ** 2 * np.eye(3), 0.0))
    for window in stillness.feed(of.time, of.gyro, of.accel):
        zaru.window(window, bias, NAN)
    bias.predict(float(of.time[-1]))
    return bias


def test_over_simulated_wear_it_is_not_overconfident() -> None:
    """Walk as the filter assumes it, movement between rests; the quasi-static allowance makes it a little modest."""
    walk = float(np.degrees(BiasKnobs().rate_random_walk))
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        pieces = [p for _ in range(4) for p in (Still(4.0), swing(rng, 4.0, np.radians(90.0)))]
        of = stream(pieces, 32.0, seed=seed, spec=ImuSpec(rrw_dps_per_sqrt_s=walk))
        found.append(nees(rested(of).state, of.bias[-1]))
    assert 0.4 < np.mean(found) < band(len(found))[1]


def test_without_the_walk_it_would_be() -> None:
    """The same with a bias that walks five times as far: the test above can fail."""
    walk = float(np.degrees(BiasKnobs().rate_random_walk))
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        pieces = [p for _ in range(4) for p in (Still(4.0), swing(rng, 4.0, np.radians(90.0)))]
        of = stream(pieces, 32.0, seed=seed, spec=ImuSpec(rrw_dps_per_sqrt_s=5 * walk))
        found.append(nees(rested(of).state, of.bias[-1]))
    assert np.mean(found) > band(len(found))[1]


def test_coarse_gyros_are_not_believed_beyond_their_step() -> None:
    scores = []
    for seed, noise in enumerate(np.tile([0.0, 0.005, 0.02, 0.05], 3)):
        of = stream([Still(25.0)], 25.0, seed=seed, spec=ImuSpec(noise_dps=float(noise), step_dps=0.061))
        device = DeviceSession(NAME)
        feed(device, of.batches())
        assert device.tracker.state is not None
        state = device.tracker.state
        scores.append((state.x - of.bias[-1]) / state.std)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5
    assert np.abs(scores).max() < 4


@pytest.mark.parametrize("misalignment_deg", [0.0, 1.0])
def test_published_deviations_of_corrected_rates_are_honest(misalignment_deg: float) -> None:
    """Calibrated, then worn: (corrected - true) / published, over all samples of twelve devices.

    Elements of the misalignment are uniform within ±1°: 0.01 rms, as a part is believed to be made.
    """
    knobs = SessionKnobs(prior=PriorKnobs(misalignment_std=np.radians(misalignment_deg) / np.sqrt(3)))
    scores, resting = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        wear = [p for _ in range(4) for p in (swing(rng, 4.0, np.radians(100.0)), Still(3.0))]
        spec = ImuSpec(
            rrw_dps_per_sqrt_s=0.002, bias_dps_per_kelvin=0.03, warm_up_s=60.0, misalignment_deg=misalignment_deg
        )
        of = calibration(seed=seed, spec=spec, after=wear)
        corrected = [b for b in feed(DeviceSession(NAME, knobs), of.batches()).corrected if b.quality.name == "GOOD"]
        for b in corrected:
            true = of.rate[b.sequence : b.sequence + len(b)]
            score = (b.rate - true) / b.rate_std
            scores.append(score)
            resting.append(score[(true == 0).all(axis=1)])
    every = np.concatenate(scores)
    assert 0.8 < np.sqrt(np.mean(every**2)) < 1.1
    assert np.mean(np.abs(every) > 1.96) < 0.065
    assert 0.9 < np.sqrt(np.mean(np.concatenate(resting) ** 2)) < 1.1


def test_calibrated_bias_is_honest_from_the_first_good_sample() -> None:
    found = []
    for seed in range(24):
        of = calibration(seed=seed, spec=ImuSpec(rrw_dps_per_sqrt_s=0.002))
        device = DeviceSession(NAME)
        for batch in of.batches():
            if feed(device, [batch]).calibration is not None:
                break
        assert device.tracker.state is not None
        found.append(nees(device.tracker.state, of.bias[batch.sequence + len(batch) - 1]))
    assert 0.3 < np.mean(found) < band(len(found))[1]


def test_the_insistence_is_long_enough_for_what_a_bed_turns() -> None:
    assert ZaruKnobs().insist_s >= 120
