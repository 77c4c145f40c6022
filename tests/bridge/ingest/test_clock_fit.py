"""The clock fit: usable at once, robust to lateness, bursts and a host clock that is set."""

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.ingest.clock_fit import ClockFit
from tests.bridge.ingest.arrivals import bursts

EPOCH_NS = 1_700_000_000 * 10**9


def feed(clock: ClockFit, device: NDArray[np.float64], host_s: NDArray[np.float64]) -> None:
    for device_s, at_s in zip(device.tolist(), host_s.tolist(), strict=True):
        clock.observe(device_s, EPOCH_NS + round(at_s * 1e9))


def error_s(clock: ClockFit, device_s: float, host_s: float) -> float:
    return (clock.host_ns(device_s) - EPOCH_NS) * 1e-9 - host_s


def test_the_first_batch_is_enough() -> None:
    clock = ClockFit()
    assert clock.host_ns(5.0) == 0
    clock.observe(100.0, EPOCH_NS)
    assert clock.rate == 1.0
    assert clock.host_ns(100.0) == EPOCH_NS
    assert clock.host_ns(99.5) == EPOCH_NS - 500_000_000


@pytest.mark.parametrize("skew", [0.0, 1e-3, -1e-3])
def test_after_ten_seconds_a_sample_s_time_is_known_to_a_millisecond(skew: float) -> None:
    errors = []
    for seed in range(5):
        device, host = bursts(np.random.default_rng(seed), 40.0, 104.0, skew)
        clock = ClockFit()
        for device_s, at_s in zip(device.tolist(), host.tolist(), strict=True):
            feed(clock, np.array([device_s]), np.array([at_s]))
            if device_s > 10:
                errors.append(error_s(clock, device_s, (1 + skew) * device_s))
    assert np.abs(errors).max() < 1e-3
    assert clock.rate_error < 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_a_rate_near_one_is_taken_to_be_one_until_it_is_surely_another(seed: int) -> None:
    def fit(skew: float, seconds: float) -> ClockFit:
        device, host = bursts(np.random.default_rng(seed), seconds, 50.0, skew)
        clock = ClockFit()
        feed(clock, device, host)
        return clock

    too_early = fit(0.01, 4.5)
    assert (too_early.rate, too_early.measured) == (1.0, False)
    assert fit(0.01, 6.5).rate == pytest.approx(1.01, abs=2e-3)  # which 1 is not in the interval of
    as_promised = fit(0.0, 8.5)
    assert as_promised.measured
    assert as_promised.rate == 1.0 or abs(as_promised.rate - 1) > as_promised.rate_error
    assert fit(0.0, 12.5).rate != 1.0


def test_what_was_held_up_for_long_and_comes_at_once_moves_nothing() -> None:
    device = np.arange(0, 100, 0.02)
    host = device + 0.002
    held = (device >= 30) & (device < 50)
    host[held] = 50.002  # a link that was dead for twenty seconds
    clock = ClockFit()
    feed(clock, device[device < 50], host[device < 50])
    assert abs(error_s(clock, 40.0, 40)) < 0.01
    feed(clock, device[device >= 50], host[device >= 50])
    assert abs(error_s(clock, 99.0, 99)) < 0.01
    assert clock.rate == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("speed", [0.1, 1.0, 50.0])
def test_a_replay_at_any_speed_is_followed(speed: float) -> None:
    device = np.arange(0, 30, min(0.02 * max(1.0, speed), 1.0))
    clock = ClockFit()
    feed(clock, device, device / speed + 0.001)
    assert clock.rate == pytest.approx(1 / speed, rel=0.01)
    assert abs(error_s(clock, 29.0, 29 / speed)) < 0.01


def test_a_host_clock_set_back_or_forward_is_followed_and_the_rate_kept() -> None:
    device = np.arange(0, 100, 0.02)
    host = device + 0.002
    host[2000:] -= 3600
    clock = ClockFit()
    feed(clock, device[:2001], host[:2001])
    assert abs(error_s(clock, 40.0, 40 - 3600)) < 0.01  # at once
    host[3000:] += 7200
    feed(clock, device[2001:], host[2001:])
    assert abs(error_s(clock, 99.0, 99 + 3600)) < 0.01  # after some seconds
    assert clock.rate == pytest.approx(1.0, abs=1e-4)


def test_a_flush_of_old_bytes_at_the_beginning_does_no_lasting_harm() -> None:
    device = np.arange(0, 30, 0.02)
    host = np.maximum(device, 3.0) + 0.002
    clock = ClockFit()
    feed(clock, device, host)
    assert abs(error_s(clock, 29.0, 29)) < 0.05
    assert clock.rate == pytest.approx(1.0, abs=0.01)
