"""Repeats, losses and silences."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import Quality, State
from estimator.session import DeviceSession
from tests.estimator.session.lives import calibrated, state
from tests.estimator.stream import NAME, Stream, feed, rates
from tests.estimator.track.worn import PLAIN, rest
from tests.sentences import free


def test_a_lost_device_is_not_good_and_comes_back(once: Stream) -> None:
    device = calibrated(once.part(0, once.at(40.0)))
    assert device.silence(free("no samples for 3 s"))
    assert not device.silence(free("no samples for 4 s")), "no news"
    assert device.status(1).reason == free("no samples for 4 s")
    assert (device.status(1).state, device.status(1).quality) == (State.LOST, Quality.DEGRADED)
    assert device.recalibrate("nurse", "") is not None
    start = once.at(43.0)
    outcome = feed(device, once.part(start, len(once)).batches(first=start))
    assert outcome.said[0] == "heard again"
    assert state(device) is State.TRACKING
    assert outcome.corrected[-1].quality is Quality.GOOD
    assert device.status(1).events["missing_samples"] == start - once.at(40.0)


@pytest.mark.parametrize(
    "damage",
    [
        lambda batches: [b for b in batches for _ in range(2)],
        lambda batches: [b for pair in zip(batches, batches[3:], strict=False) for b in pair],
        lambda batches: [
            b for i, b in enumerate(batches) for b in ([b] if i % 50 else [b, *batches[max(0, i - 5) : i]])
        ],
    ],
    ids=["each twice", "ahead and behind", "bursts again"],
)
def test_repeats_change_no_rate(once: Stream, damage: Callable[..., list[object]]) -> None:
    batches = once.batches()
    whole = feed(DeviceSession(NAME), batches)
    device = DeviceSession(NAME)
    damaged = damage(batches)
    outcome = feed(device, damaged)  # type: ignore[arg-type]
    status = device.status(1)
    assert status.samples_in == status.samples_out + sum(status.dropped.values())
    assert status.dropped["duplicate"] > 0
    numbers = np.concatenate([b.sequence + np.arange(len(b)) for b in outcome.corrected])
    assert len(set(numbers.tolist())) == len(numbers) == status.samples_out
    if status.events.get("gaps", 0) == 0:
        np.testing.assert_array_equal(rates(outcome.corrected), rates(whole.corrected))


def test_one_percent_of_lost_batches_in_the_rests_does_no_harm(once: Stream) -> None:
    still = np.linalg.norm(once.rate, axis=1) == 0
    rng = np.random.default_rng(0)
    kept = [b for b in once.batches() if not (still[b.sequence : b.sequence + len(b)].all() and rng.random() < 0.01)]
    device = DeviceSession(NAME)
    outcome = feed(device, kept)
    assert outcome.calibration is not None
    np.testing.assert_allclose(np.diag(outcome.calibration.matrix), once.truth.k, atol=2e-4)
    assert device.status(1).events["missing_samples"] == len(once) - sum(map(len, kept))


@pytest.mark.parametrize("silent_s", [60.0, 600.0])
def test_what_has_cooled_in_a_silence_is_corrected_as_cold_from_its_first_sample_on(silent_s: float) -> None:
    """The tracker knows the first second when it is over; until then it was said, and said to be good, what was before."""
    spec = replace(PLAIN, bias_dps_per_kelvin=0.03, temperature_c=(25.0, 35.0), warm_up_s=200.0)
    warm = rest(200.0, spec=spec)
    cold = warm.part(0, warm.at(10.0))
    ticks = cold.ticks + warm.ticks[-1] + round(silent_s * 1e6)
    device = DeviceSession(NAME)
    feed(device, warm.batches())
    first, *_ = feed(device, replace(cold, ticks=ticks).batches(first=len(warm))).corrected
    warmer = first.bias - warm.bias[-1]
    assert np.abs(warmer).max() > np.radians(0.1), "it is another bias than before"
    assert (np.abs(first.bias - cold.bias[0]) < 4 * first.bias_std).all()
    assert (first.bias_std < np.radians(0.05)).all()
