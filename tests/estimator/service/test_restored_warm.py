"""A device that still warms up when its estimator is restarted: what was kept is brought to the temperature there is."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.imu_errors import DEMO_SPEC
from bridge.sim.motion_scripts import demo_script
from bridge.sim.sample_source import SimulatedSource
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.session import DeviceSession
from estimator.samples.sample_buffer import Samples
from estimator.tracking.bias_state import BiasState
from tests.estimator.stream import NAME, Stream, feed

#: a bridge says again what it sent so long before the restart, s
_AGAIN_S = 5.0


def worn(seed: int, seconds: float) -> Stream:
    """A device that is calibrated after its power-up and then moved and put down, as a demo's."""
    source = SimulatedSource(demo_script, DEMO_SPEC, 104.0)
    truth = source.power_up(np.random.default_rng(seed), 1.0)
    samples = [source.read() for _ in range(round(seconds))]

    truths = [s.truth for s in samples if s.truth is not None]
    ticks = np.round(np.concatenate([s.clock_s for s in samples]) * 1e6).astype(np.int64)
    gyro, accel, celsius = (
        np.concatenate([getattr(s, name) for s in samples]) for name in ("gyro", "accel", "temperature_c")
    )
    rate, bias = (np.concatenate([getattr(true, name) for true in truths]) for name in ("rate", "bias"))
    return Stream(ticks, gyro, accel, celsius, rate, bias, truth, 104.0)


def surprise(of: Stream, device: DeviceSession, kept: BiasState) -> float:
    """The mean squared error, in variances said, of a restarted session's bias while it is told of what was kept already."""
    batches = of.batches()
    batches = [b for b in batches if kept.time - _AGAIN_S <= b.device_time[0] < kept.time - 1.0]
    again, first = DeviceSession(NAME), batches[0]
    again.begin_boot(
        1, float(first.device_time[0]), PriorKnowledge(device.calibration, kept), None, Samples.of(first).celsius
    )
    corrected = feed(again, batches).corrected
    off = [(batch.bias - of.bias[batch.sequence]) / batch.bias_std for batch in corrected]
    return float(np.mean(np.square(off)))


@pytest.fixture(scope="module")
def lives() -> list[tuple[Stream, DeviceSession, BiasState]]:
    """Some that were calibrated a while ago and are still warming, and what was kept of their bias."""
    found = []
    for seed in range(6):
        of, device = worn(seed, 70.0), DeviceSession(NAME)
        feed(device, of.batches())
        kept = device.checkpoint()
        assert kept is not None
        assert device.calibration is not None
        found.append((of, device, kept))
    return found


def test_a_warming_device_is_gone_on_with_as_surely_as_said(
    lives: list[tuple[Stream, DeviceSession, BiasState]],
) -> None:
    """Its thermometer's average is behind; begun anew it was not: up to 4 standard deviations (make bench-faults)."""
    assert np.mean([surprise(*life) for life in lives]) < 0.6
    assert np.mean([surprise(of, device, replace(kept, lag_k=0.0)) for of, device, kept in lives]) > 1.0
