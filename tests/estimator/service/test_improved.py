"""A rest after a gap improves the past: the session says so in a revision of its corrected rates."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import swing
from estimator.client import revised
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.tracking.bias_state import BiasKnobs
from estimator.tracking.track_knobs import TrackKnobs
from tests.estimator.stream import NAME, Stream, calibration, feed

WALK_DPS = 0.003
KNOBS = SessionKnobs(track=TrackKnobs(bias=BiasKnobs(rate_random_walk=np.radians(WALK_DPS))))
MOVED_S, RESTED_S = 150.0, 20.0


@pytest.fixture(scope="module")
def busy() -> Stream:
    """Calibrated, then minutes of movement, then rest; a bias that walks fast."""
    rng = np.random.default_rng(5)
    wear = [swing(rng, 6.0, np.radians(90.0)) for _ in range(round(MOVED_S / 6))]
    spec = ImuSpec(rrw_dps_per_sqrt_s=WALK_DPS, noise_dps=0.05)
    return calibration(seed=5, spec=spec, after=[*wear, Still(RESTED_S)])


@pytest.mark.parametrize("accel", [True, False])
def test_a_rest_after_a_gap_improves_the_rates_of_the_gap(busy: Stream, accel: bool) -> None:
    device = DeviceSession(NAME, KNOBS)
    corrected, revisions = [], []
    for batch in busy.batches(accel=accel):
        outcome = feed(device, [batch])
        corrected += outcome.corrected
        revisions += outcome.revisions
    revision = max(revisions, key=lambda one: len(one.sequences))
    [again] = revision.reason
    assert again.code == Code.AT_REST_AGAIN
    assert float(again.params["gap_s"]) == pytest.approx(MOVED_S, abs=12.0)
    assert revision.boot == 1
    assert (np.diff(revision.sequences.astype(int)) > 0).all()
    # Each point is at its sample's own time.
    start = 1_700_000_000_000_000_000
    own = [start + int(busy.ticks[int(sequence)]) * 1000 for sequence in revision.sequences]
    np.testing.assert_allclose(revision.times_ns - np.array(own), 0, atol=2000)
    moving = [b for b in corrected if revision.sequences[0] <= b.sequence <= revision.sequences[-1] - 10]
    true = np.concatenate([busy.rate[b.sequence : b.sequence + len(b)] for b in moving])
    live, later = (
        np.concatenate([b.rate for b in batches]) - true for batches in (moving, [revised(b, revision) for b in moving])
    )
    at = [int(s) for s in revision.sequences]
    before = np.array([busy.bias[int(s)] for s in at])
    live_bias = np.array([next(b.bias for b in corrected if b.sequence <= s < b.sequence + len(b)) for s in at])
    rms = [float(np.degrees(np.sqrt(np.mean(np.square(e - before))))) for e in (live_bias, revision.bias)]
    assert rms[1] < 0.75 * rms[0], rms
    assert np.sqrt(np.mean(later**2)) < np.sqrt(np.mean(live**2))
    score = (revision.bias - before) / revision.bias_std
    assert np.sqrt(np.mean(score**2)) < 1.6


def test_without_a_gap_there_is_nothing_to_say(busy: Stream) -> None:
    device = DeviceSession(NAME, KNOBS)
    end = busy.at(busy.time[-1] - MOVED_S - RESTED_S)
    rest = replace(busy.part(0, end))
    outcomes = [feed(device, [batch]) for batch in rest.batches()]
    assert device.calibration is not None
    assert all(len(revision.sequences) < 30 for o in outcomes for revision in o.revisions)
