"""One device through parts of its life."""

from dataclasses import replace

import numpy as np

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, session, swing
from bridge.wire.messages import State
from estimator.device.session import DeviceSession
from tests.estimator.stream import NAME, Stream, feed, stream


def worn(seed: int, bursts: int = 6) -> list[object]:
    rng = np.random.default_rng(seed)
    return [p for _ in range(bursts) for p in (swing(rng, 3.0, np.radians(100.0)), Still(4.0))]


def calibrated(of: Stream, boot: int = 1) -> DeviceSession:
    device = DeviceSession(NAME)
    feed(device, of.batches(boot=boot))
    assert state(device) is State.TRACKING, device.life.reason
    return device


def state(device: DeviceSession) -> State:
    return device.life.state


def again(of: Stream, *turns: TurnPlan, seed: int = 5, rest_s: float = 30.0) -> Stream:
    """The same device, turned once more, its samples going on after those of `of`."""
    plan = SessionPlan(turns=turns or (TurnPlan(2), TurnPlan(0), TurnPlan(1)), turn_s=(4.0, 5.0))
    pieces = [Still(rest_s), *session(np.random.default_rng(seed), plan)]
    perfect = ImuSpec(scale=(1.0, 1.0), bias_limit_dps=0.0)
    more = stream(pieces, sum(p.duration_s for p in pieces), spec=perfect, attitude=of.attitude[-1])
    gyro = more.rate / of.truth.k + of.bias[0] + (more.gyro - more.rate)
    warm = np.full(len(more), of.temperature_c[-1])
    return replace(more, ticks=more.ticks + of.ticks[-1], gyro=gyro, temperature_c=warm, truth=of.truth)


def shaken(of: Stream, seconds: float = 70.0) -> Stream:
    """The same device, its samples going on without any rest."""
    more = again(of, rest_s=seconds).part(0, int(seconds * of.rate_hz))
    return replace(more, gyro=more.gyro + np.radians(30.0) * np.sin(9.0 * more.time)[:, None])


def off(of: Stream, dps: float, seconds: float) -> Stream:
    """The device goes on resting, but reads this much more."""
    more = stream([Still(seconds)], seconds, seed=77, attitude=of.attitude[-1])
    gyro = more.gyro - more.bias + of.bias[0] + np.radians([0.0, 0.0, dps])
    warm = np.full(len(more), of.temperature_c[-1])
    return replace(more, ticks=more.ticks + of.ticks[-1], gyro=gyro, temperature_c=warm)
