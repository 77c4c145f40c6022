"""The filter's own word against the truth it does not see: NEES of many simulated biases, in 99.9 % bands."""

import numpy as np
import pytest
from scipy.stats import chi2

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import PriorKnobs
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import OWN, BiasKnobs, BiasState, start
from estimator.tracking.evidence import GATES, Evidence
from estimator.tracking.track_knobs import TrackKnobs
from tests.estimator.stream import NAME, calibration, feed, stream

#: parts whose bias walks and follows temperature as the knobs below believe; a coefficient is uniform within its limits
RRW_DPS = 0.002
WALKING = BiasKnobs(rate_random_walk=np.radians(RRW_DPS))
PER_KELVIN_DPS = float(np.degrees(WALKING.per_kelvin) * np.sqrt(3))


def band(n: int) -> tuple[float, float]:
    """Where the mean of n NEES / 3 lies in 99.9 % of cases."""
    low, high = chi2.ppf([0.0005, 0.9995], 3 * n)
    return float(low) / (3 * n), float(high) / (3 * n)


def nees(state: BiasState, truth: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    error = state.bias - truth
    return float(error @ np.linalg.solve(state.bias_cov, error)) / 3


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
        bias = BiasFilter(start(np.zeros(3), P0, 0.0, knobs), knobs)
        time = 0.0
        for _ in range(12):
            dt = rng.uniform(1.0, 20.0)
            time += dt
            truth = truth + walk_factor * knobs.rate_random_walk * np.sqrt(dt) * rng.normal(size=3)
            bias.predict(time)
            z = truth + sigma * rng.normal(size=3)
            bias.update(Evidence("zaru", z, np.eye(3, OWN), sigma**2 * np.eye(3), GATES[3]))
        bias.predict(time + 30.0)
        truth = truth + walk_factor * knobs.rate_random_walk * np.sqrt(30.0) * rng.normal(size=3)
        found.append(nees(bias.state, truth))
    low, high = band(len(found))
    inside = low < float(np.mean(found)) < high
    assert inside is (walk_factor == 1.0), (np.mean(found), low, high)


def test_coarse_gyros_are_not_believed_beyond_their_step() -> None:
    scores = []
    for seed, noise in enumerate(np.tile([0.0, 0.005, 0.02, 0.05], 3)):
        of = stream([Still(25.0)], 25.0, seed=seed, spec=ImuSpec(noise_dps=float(noise), step_dps=0.061))
        device = DeviceSession(NAME)
        feed(device, of.batches())
        state = device.tracker.state
        scores.append((state.bias - of.bias[-1]) / state.std)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5
    assert np.abs(scores).max() < 4


@pytest.mark.parametrize("misalignment_deg", [0.0, 1.0])
def test_published_deviations_of_corrected_rates_are_honest(misalignment_deg: float) -> None:
    """Calibrated, then worn: (corrected - true) / published, over all samples of twelve devices.

    Elements of the misalignment are uniform within ±1°: 0.01 rms, as a part is believed to be made.
    """
    prior = PriorKnobs(misalignment_std=np.radians(misalignment_deg) / np.sqrt(3))
    knobs = SessionKnobs(prior=prior, track=TrackKnobs(bias=WALKING))
    scores, resting = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        wear = [p for _ in range(4) for p in (swing(rng, 4.0, np.radians(100.0)), Still(3.0))]
        spec = ImuSpec(
            rrw_dps_per_sqrt_s=RRW_DPS,
            bias_dps_per_kelvin=PER_KELVIN_DPS,
            warm_up_s=60.0,
            misalignment_deg=misalignment_deg,
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
    # Warm within a minute: what the thermometer's average lags behind makes it a little timid.
    assert 0.85 < np.sqrt(np.mean(np.concatenate(resting) ** 2)) < 1.1


def test_calibrated_bias_is_honest_from_the_first_good_sample() -> None:
    found = []
    for seed in range(24):
        of = calibration(seed=seed, spec=ImuSpec(rrw_dps_per_sqrt_s=RRW_DPS, bias_dps_per_kelvin=PER_KELVIN_DPS))
        device = DeviceSession(NAME, SessionKnobs(track=TrackKnobs(bias=WALKING)))
        for batch in of.batches():
            if feed(device, [batch]).calibration is not None:
                break
        found.append(nees(device.tracker.state, of.bias[batch.sequence + len(batch) - 1]))
    assert 0.3 < np.mean(found) < band(len(found))[1]
