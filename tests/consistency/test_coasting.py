"""Who lies and breathes, of a device that an estimator with too much to do learns from only now and then: no false doubt."""

import numpy as np
import pytest

from bridge.sim.body import Activity, Body
from bridge.sim.day import Day, anyhow, recorded, worn_spec
from bridge.sim.imperfection import Imperfection
from bridge.sim.life import Wearer
from bridge.sim.scenes import Steps
from estimator.gyro import GyroModel
from estimator.service.coasting import LEARNS_S, MOST
from estimator.stillness import Stillness
from estimator.track.tracker import Tracker, TrackKnobs

_RATE_HZ, _REST_S, _LIES_S = 50.0, 60.0, 1200.0


def sleeper(seed: int) -> Day:
    rng, sensor_rng = np.random.default_rng([seed, 2]).spawn(2)
    wearer, spec, seconds = Wearer(rng), worn_spec(_RATE_HZ), _REST_S + _LIES_S
    lies = wearer.quiet(Activity.LYING, _LIES_S, breath=1.0)
    body = Body(iter([wearer.table(_REST_S), lies]), attitude=anyhow(rng))
    steps = Steps(rng, 0.0, spec.temperature_c[0], seconds)
    return recorded(body, Imperfection(spec, sensor_rng), steps, seconds, _RATE_HZ)


@pytest.mark.parametrize("share", [0.25, MOST])
@pytest.mark.parametrize("accel", [True, False], ids=["aided", "gyro only"])
def test_one_who_sleeps_is_tracked_and_not_doubted(share: float, *, accel: bool) -> None:
    coasts_s, nees = LEARNS_S * share / (1 - share), []
    for seed in (10, 11, 12):
        day, known, std = sleeper(seed), np.full(3, 1e-3), np.radians(0.02)
        begin = day.bias[0] + std * np.random.default_rng(seed).normal(size=3)
        tracker = Tracker(TrackKnobs(), 0.0, GyroModel(day.truth.matrix, begin, known, known, known), np.full(3, std))
        force = day.accel.astype(float) if accel else None
        for windows in Stillness().feed(day.time_s, day.gyro.astype(float), force).each():
            ((_, now, sample, _),) = windows.heads
            tracker.thermometer.read(now, float(day.temperature_c[sample]))
            if tracker.settled and now > _REST_S and now % (LEARNS_S + coasts_s) > LEARNS_S:
                tracker.coast(windows)
            else:
                tracker.take(windows)
            assert tracker.doubts(now) is None
        error = tracker.bias - day.bias[-1]
        nees.append(error @ np.linalg.solve(tracker.state.bias_cov, error) / 3)
        assert (np.degrees(tracker.std) < 0.03).all()
    assert np.mean(nees) < 2.2
