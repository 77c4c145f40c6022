"""A run that is cut, saved as bytes and gone on with elsewhere equals the whole run, bit for bit."""

import zlib
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.wire.messages import BiasRevision, CorrectedBatch, SampleBatch, State, Status
from estimator.device.resting_poses import PosesState, RestingPoses
from estimator.device.session import TURNS_LOST, DeviceSession
from estimator.state import StateStruct, decode, encode
from tests.estimator.device.session.lives import again, state, worn
from tests.estimator.stream import NAME, calibration, feed
from tests.sentences import codes

#: bytes of a device at 100 samples a second
MOST_BYTES = 12_500


@cache
def life(*, aided: bool) -> tuple[list[SampleBatch], list[SampleBatch]]:
    """Calibrated, and then: at rest, moved for longer than a gap, at rest, and turning to and fro as who breathes."""
    once = calibration(seed=1, after=worn(1))  # type: ignore[arg-type]
    after = again(once, rest_s=120.0).part(0, 11_000)
    t = after.time - after.time[0]
    turning = np.where((t > 10.0) & (t < 40.0), np.radians(30.0) * np.sin(9.0 * t), 0.0)
    turning = np.where(t > 65.0, np.radians(0.8) * np.sin(1.6 * t), turning)
    after = replace(after, gyro=after.gyro + turning[:, None])
    return once.batches(accel=aided), after.batches(first=len(once), accel=aided)


def told(corrected: list[CorrectedBatch]) -> dict[int, tuple[object, ...]]:
    """What was said of each sample."""
    found: dict[int, tuple[object, ...]] = {}
    for batch in corrected:
        arrays = batch.bias, batch.bias_std, batch.noise_std, batch.scale_std, batch.cross_std, batch.flicker_std
        of_all = *(array.tobytes() for array in arrays), batch.quality, batch.calibration
        for i, (rate, flag) in enumerate(zip(batch.rate, batch.flags, strict=True)):
            found[batch.sequence + i] = (rate.tobytes(), int(flag), *of_all)
    return found


def begun(*, aided: bool) -> DeviceSession:
    device = DeviceSession(NAME)
    feed(device, life(aided=aided)[0])
    assert state(device) is State.TRACKING
    return device


def ended(device: DeviceSession) -> tuple[Status, bytes | None]:
    said = device.status(0)
    return replace(said, samples_in=0, samples_out=0, dropped={}, events={}, receipts=()), device.state()


@pytest.mark.parametrize("aided", [True, False])
def test_a_run_cut_at_any_sample_and_resumed_equals_the_whole_run(*, aided: bool) -> None:
    batches = life(aided=aided)[1]
    whole, corrected, revisions = begun(aided=aided), list[CorrectedBatch](), list[BiasRevision]()
    saved: dict[int, bytes | None] = {}
    cuts = np.random.default_rng(0).choice(len(batches), 10, replace=False)
    for number, batch in enumerate(batches):
        if number in cuts:
            saved[number] = whole.state()
        outcome = feed(whole, [batch])
        corrected += outcome.corrected
        revisions += outcome.revisions
    expected = told(corrected)
    assert revisions, "evidence came back after a gap"
    for number, bytes_ in saved.items():
        assert bytes_ is not None
        assert len(bytes_) < MOST_BYTES
        resumed = DeviceSession.restored(bytes_, whole.calibration, NAME)
        first = resumed.sequence.next
        assert first is not None
        assert batches[number].sequence - 250 < first <= batches[number].sequence
        outcome = feed(resumed, [batch for batch in batches if batch.sequence + len(batch) > first])
        again_told = told(outcome.corrected)
        assert again_told == {n: what for n, what in expected.items() if n >= first}
        assert ended(resumed) == ended(whole)
        for revision in outcome.revisions:  # it reaches back to the cut
            same = next(one for one in revisions if one.time_ns == revision.time_ns)
            n = len(revision.sequences)
            np.testing.assert_array_equal(same.sequences[-n:], revision.sequences)
            np.testing.assert_array_equal(same.bias[-n:], revision.bias)


def test_turns_of_a_calibration_under_way_are_said_to_be_lost() -> None:
    once = calibration(seed=1)
    batches = once.batches()
    device = DeviceSession(NAME)
    for batch in batches:
        feed(device, [batch])
        if len(device.learnt.turned) == 2:
            break
    bytes_ = device.state()
    assert bytes_ is not None
    resumed = DeviceSession.restored(bytes_, None, NAME)
    assert Code.TURNS_LOST in codes(resumed.status(0).reason)
    assert resumed.sequence.events.as_dict()[TURNS_LOST] == 2
    assert state(resumed) is State.AWAITING_STILL


def test_a_state_of_another_device_or_calibration_or_none_is_refused() -> None:
    device = begun(aided=True)
    bytes_, used = device.state(), device.calibration
    assert bytes_ is not None
    assert used is not None
    assert DeviceSession("d").state() is None
    with pytest.raises(ValueError, match="'other', version"):
        DeviceSession.restored(bytes_, used, "other")
    for another in (None, replace(used, id="another")):
        with pytest.raises(ValueError, match="the saved state needs calibration"):
            DeviceSession.restored(bytes_, another, NAME)
    with pytest.raises(ValueError, match="damaged state"):
        DeviceSession.restored(b"", used, NAME)


def test_arrays_of_endless_shape_or_rests_without_samples_are_no_state() -> None:
    endless = ["d", [2**64 - 1] * 100_000, b""]  # the product of these would take half a minute
    with pytest.raises(ValueError, match="100000 dimensions"):
        decode(zlib.compress(msgspec.msgpack.encode([endless, ["d", [6], bytes(48)]])), PosesState)
    with pytest.raises(ValueError, match="a rest has no samples"):
        RestingPoses().restore(PosesState(np.empty((0, 5)), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])))


def test_a_damaged_state_is_refused_or_goes_on_with_numbers() -> None:
    device, batches = begun(aided=True), life(aided=True)[1]
    feed(device, batches[:50])
    bytes_ = device.state()
    assert bytes_ is not None
    rng = np.random.default_rng(0)
    for _ in range(200):
        damaged = bytearray(bytes_)
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        try:
            resumed = DeviceSession.restored(
                bytes(damaged[: rng.integers(len(damaged)) or None]), device.calibration, NAME
            )
        except ValueError:
            continue
        assert np.isfinite(resumed.status(0).bias).all()


def test_the_same_state_is_the_same_bytes() -> None:
    class Names(StateStruct):
        names: set[str]

    names = [f"kind {n}" for n in range(50)]
    backward = [*reversed(names)]
    assert encode(Names(set(names))) == encode(Names(set(backward)))
