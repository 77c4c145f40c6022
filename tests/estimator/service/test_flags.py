"""What a bridge marked: stuck readings are no evidence, a temperature that leapt is not believed, late samples are corrected."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire.messages import SampleBatch, SampleFlag, State
from estimator.device.session import DeviceSession
from tests.estimator.stream import NAME, Stream, calibration, feed, rates, stream


@pytest.fixture(scope="module")
def rested() -> Stream:
    """Calibrated, then at rest for half a minute."""
    return calibration(seed=8, after=[Still(30.0)])


def marked(of: Stream, at: slice, flag: SampleFlag) -> list[SampleBatch]:
    batches = []
    for batch in of.batches():
        number, flags = batch.sequence + np.arange(len(batch)), batch.flags.copy()
        flags[(number >= at.start) & (number < at.stop)] = flag
        batches.append(replace(batch, flags=flags))
    return batches


@pytest.mark.parametrize("flag", [SampleFlag.STUCK, SampleFlag.CLIPPED])
def test_readings_that_stand_still_but_are_marked_are_no_rest(flag: SampleFlag) -> None:
    still = stream([Still(8.0)], 8.0, seed=3)
    frozen = replace(still, gyro=np.repeat(still.gyro[:1], len(still), axis=0))
    honest, deceived = DeviceSession(NAME), DeviceSession(NAME)
    feed(honest, marked(frozen, slice(5, len(frozen)), flag))
    feed(deceived, frozen.batches())
    assert honest.life.state is State.AWAITING_STILL
    assert deceived.life.state is State.BIAS_ONLY, "the mark is what counts"


def test_one_marked_sample_costs_its_own_window_only() -> None:
    still = stream([Still(8.0)], 8.0, seed=3)
    device = DeviceSession(NAME)
    feed(device, marked(still, slice(150, 151), SampleFlag.STUCK))
    assert device.life.state is State.BIAS_ONLY


def test_a_temperature_that_leapt_is_not_believed(rested: Stream) -> None:
    at = len(rested) - 15 * 104  # the tracker itself would believe it after ten seconds
    warm = rested.temperature_c.copy()
    warm[at:] += 3.0
    device, deceived = DeviceSession(NAME), DeviceSession(NAME)
    feed(device, marked(replace(rested, temperature_c=warm), slice(at, len(rested)), SampleFlag.TEMPERATURE_STEP))
    feed(deceived, replace(rested, temperature_c=warm).batches())
    assert device.status(0).temperature_c == pytest.approx(rested.temperature_c[at], abs=0.2)
    assert deceived.status(0).temperature_c == pytest.approx(rested.temperature_c[at] + 3.0, abs=1.0)


def test_late_samples_are_corrected_as_any_and_say_so(rested: Stream) -> None:
    late = slice(len(rested) - 1000, len(rested) - 500)
    outcome, plain = (feed(DeviceSession(NAME), of) for of in (marked(rested, late, SampleFlag.LATE), rested.batches()))
    np.testing.assert_array_equal(rates(outcome.corrected), rates(plain.corrected))
    flags = np.concatenate([batch.flags for batch in outcome.corrected])
    assert np.flatnonzero(flags == SampleFlag.LATE).tolist() == list(range(late.start, late.stop))
