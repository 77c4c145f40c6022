"""An accelerometer that was given up has misled the bias: what is smoothed is no surer of the time before than of now."""

from dataclasses import replace

import numpy as np

from bridge.sim.motion import Still
from bridge.sim.script import swing
from tests.estimator.stream import stream
from tests.estimator.track.worn import LEVEL, PLAIN, Worn

_RESTS_S = 20.0


def test_the_past_is_doubted_too_since_the_last_rest() -> None:
    moves = [swing(np.random.default_rng(i), 6.0, 1.0) for i in range(12)]
    of = stream([Still(_RESTS_S), *moves], 90.0, spec=PLAIN, attitude=LEVEL)
    mirrored = np.where(of.time[:, None] > _RESTS_S, of.accel * [-1.0, 1.0, 1.0], of.accel)
    worn = Worn.new(of.bias[0], 0.01).lives(replace(of, accel=mirrored))
    assert "accelerometer disbelieved" in worn.tracker.events
    found = worn.tracker.smoothed()
    assert found is not None
    std = np.degrees(found.std.max(axis=1))
    assert (std[found.time < _RESTS_S - 2] < 0.01).all()
    assert (np.diff(std[found.time > _RESTS_S + 1]) > -1e-6).all()
    assert (std[found.time > _RESTS_S + 5] > 0.05).all(), "of which it was sure to 0.01, smoothed"
