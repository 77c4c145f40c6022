"""What outlives a restart: of the estimator, of the device, and of a device that is not what it was."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentences
from bridge.sim.motion import Still
from bridge.wire.messages import Calibration, Quality, SampleBatch, State
from estimator import history
from estimator.remembered import Remembered
from estimator.restore import changed
from estimator.service.record import SCRATCH
from estimator.session import DeviceSession
from tests.estimator.database.faults import full_disk
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, calibration, feed, info
from tests.sentences import codes, free

OTHERS: list[tuple[dict[str, Any], str]] = [
    ({"firmware": "2.0"}, "The firmware is 2.0; it was 1.0"),
    ({"model": "n"}, "The model is n; it was m"),
    ({"gyro_range": 4.36}, "The range is 4.36 rad/s; it was 8.7 rad/s"),
    ({"rate_hz": 208.0, "has_clock": False}, "The rate is 208 Hz; it was 104 Hz"),
]


@pytest.fixture(scope="module")
def once() -> Stream:
    return calibration(seed=1, after=[Still(8.0)])


def second(of: Stream) -> list[SampleBatch]:
    """The same again as another boot, a minute later."""
    later = 60 * 10**9
    return [
        replace(b, receive_time_ns=b.receive_time_ns + later, start_time_ns=b.start_time_ns + later)
        for b in of.batches(boot=2)
    ]


def an_hour_later(batches: list[SampleBatch]) -> list[SampleBatch]:
    ns = 3_600_000_000_000
    return [replace(b, receive_time_ns=b.receive_time_ns + ns, start_time_ns=b.start_time_ns + ns) for b in batches]


def restart(ward: Ward) -> None:
    ward.kill()
    ward.start()


def scratched(ward: Ward) -> list[str]:
    return [english(*row["message"]) for row in history.read(ward.store, NAME).commands if row["verb"] == SCRATCH]


@pytest.mark.parametrize(("other", "words"), OTHERS)
def test_another_device_under_the_name_begins_from_scratch_and_it_is_said(
    ward: Ward, once: Stream, other: dict[str, Any], words: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    ward.send(once.batches(), info(1))
    list(ward.subscriber)
    ward.send(second(once)[:30], replace(info(2), **other))
    assert {b.quality for b in ward.subscriber} == {Quality.NONE}
    status = ward.latest()
    assert words in english(*status.reason)
    assert Code.CALIBRATE_FROM_SCRATCH in codes(status.reason)
    assert Code.HOLD_STILL in codes(status.reason), "and what to do"
    assert words in caplog.text
    assert [words in said for said in scratched(ward)] == [True]
    restart(ward)
    ward.send(second(once)[30:60])
    assert words in english(*ward.latest().reason)
    ward.send(second(once)[60:])
    assert (ward.latest().quality, scratched(ward)) == (Quality.GOOD, scratched(ward)[:1]), "told once a boot"
    assert Code.CALIBRATE_FROM_SCRATCH not in codes(ward.latest().reason)


@pytest.mark.parametrize(("other", "words"), OTHERS)
def test_a_device_that_changes_within_a_boot_begins_from_scratch(
    ward: Ward, once: Stream, other: dict[str, Any], words: str
) -> None:
    first = replace(info(1), has_clock=other.get("has_clock", True))
    batches = once.batches()
    ward.send(batches[:-80], first)
    assert ward.latest().quality is Quality.GOOD
    list(ward.subscriber)
    ward.send(batches[-80:-40], replace(first, **other))
    after = list(ward.subscriber)
    assert {b.quality for b in after} <= {Quality.NONE, Quality.BIAS_ONLY}
    assert sum(map(len, after)) == 400, "its samples go on"
    status = ward.latest()
    assert status.state in (State.AWAITING_STILL, State.BIAS_ONLY)
    assert words in english(*status.reason)
    assert len(scratched(ward)) == 1
    restart(ward)
    ward.send(batches[-40:])
    assert ward.latest().quality in (Quality.NONE, Quality.BIAS_ONLY)
    assert words in english(*ward.latest().reason)


def test_a_power_up_under_the_same_boot_number_is_not_good_after_a_restart_either(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr("estimator.service.shell.time.monotonic", lambda: now[0])
    again = an_hour_later(calibration(seed=2, before_s=20.0).batches())
    ward.send(once.batches(), info(1))
    list(ward.subscriber)
    for batch in again[:100]:
        ward.send([batch])
        now[0] += 0.1
    assert {batch.quality for batch in ward.subscriber} <= {Quality.NONE, Quality.PRIOR, Quality.BIAS_ONLY}
    restart(ward)
    ward.send(again[100:150])
    assert {batch.quality for batch in ward.subscriber} <= {Quality.NONE, Quality.PRIOR, Quality.BIAS_ONLY}
    found = history.read(ward.store, NAME)
    assert [row["verb"] for row in found.commands] == ["boot number repeated"]
    (before,) = found.calibrations
    ward.send(again[150:])
    assert ward.latest().quality is Quality.GOOD
    *_, made = history.read(ward.store, NAME).calibrations
    assert (made.boot, made.id != before.id) == (before.boot, True)
    restart(ward)
    ward.send(again[-1:])
    assert ward.latest().calibration == made.id


def test_that_a_boot_number_came_again_is_kept_once_the_store_works(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr("estimator.service.shell.time.monotonic", lambda: now[0])
    ward.send(once.batches(), info(1))
    again = an_hour_later(calibration(seed=2, before_s=20.0).batches())
    with full_disk():
        for batch in again[:70]:
            ward.send([batch])
            now[0] += 0.1
        assert ward.service._devices[NAME].repeated is not None
    ward.latest()
    for batch in again[70:140]:
        ward.send([batch])
        now[0] += 0.1
        ward.latest()
    assert [row["verb"] for row in history.read(ward.store, NAME).commands] == ["boot number repeated"]
    list(ward.subscriber)
    restart(ward)
    ward.send(again[140:170])
    assert Quality.GOOD not in {batch.quality for batch in ward.subscriber}


def test_a_calibration_made_while_it_could_not_be_kept_that_a_boot_number_came_again_holds(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr("estimator.service.shell.time.monotonic", lambda: now[0])
    ward.send(once.batches(), info(1))
    again = an_hour_later(calibration(seed=2, before_s=20.0).batches())
    with full_disk():
        for batch in again:
            ward.send([batch])
            now[0] += 0.1
        device = ward.service._devices[NAME]
        made = device.session.calibration
    assert made is not None
    ward.service._record.checkpoint(device, now[0], force=True)  # it may be kept before that is
    for _ in range(4):
        now[0] += 6.0
        ward.latest()
    assert history.read(ward.store, NAME).calibrations[-1].id == made.id
    restart(ward)
    ward.send(again[-1:])
    assert ward.latest().calibration == made.id


def test_a_device_with_a_clock_may_be_told_another_rate(ward: Ward, once: Stream) -> None:
    ward.send(once.batches(), info(1))
    list(ward.subscriber)
    ward.send(second(once)[:30], replace(info(2), rate_hz=208.0))
    assert {b.quality for b in ward.subscriber} <= {Quality.PRIOR, Quality.BIAS_ONLY}
    assert Code.CALIBRATE_FROM_SCRATCH not in codes(ward.latest().reason)
    assert scratched(ward) == []


def test_what_was_not_known_has_not_changed() -> None:
    session = DeviceSession(NAME)
    session.info = info(1)
    feed(session, calibration(seed=1).batches())
    made = session.calibration
    assert made is not None
    assert changed(replace(made, firmware=""), info(1), within_boot=True) == ()
    assert changed(made, replace(info(1), firmware="", gyro_range=0.0), within_boot=True) == ()
    assert changed(replace(made, firmware=""), info(1))[0] == Code.FIRMWARE_CHANGED(now="1.0", then="?")


def test_after_a_reboot_the_scale_is_a_prior_and_the_bias_as_wide_as_from_power_up_to_power_up(
    ward: Ward, once: Stream
) -> None:
    ward.send(once.batches(), info(1))
    (before,) = ward.store.calibrations(NAME)
    ward.send(second(once)[:6], info(2))
    last = list(ward.subscriber)[-1]
    wide = ward.service._devices[NAME].session.knobs.prior.bias_std
    assert (last.boot, last.quality, last.calibration) == (2, Quality.PRIOR, before.id)
    assert np.all(last.bias_std >= 0.99 * wide * np.diag(before.matrix))


def test_what_held_over_earlier_boots_is_believed_more(ward: Ward, once: Stream) -> None:
    ward.send(once.batches(), info(1))
    (made,) = ward.store.calibrations(NAME)
    stds = []
    for boot in (2, 3, 4):
        ward.send([replace(batch, boot=boot) for batch in second(once)[:6]], info(boot))
        session = ward.service._devices[NAME].session
        stds.append(session.applied.model.scale_std.max())
        assert session.tracker._model.scale_std.max() == stds[-1], "by whom gravity is judged"
        ward.store.add_calibration(replace(made, id=f"c{boot}", boot=boot))
    prior = ward.service._devices[NAME].session.knobs.prior
    np.testing.assert_allclose(stds, prior.scale_std / np.sqrt([1, 4, 7]), rtol=1e-3)


def calibrated(batches: list[SampleBatch]) -> tuple[Calibration, DeviceSession]:
    device = DeviceSession(NAME)
    feed(device, batches)
    assert device.calibration is not None
    return device.calibration, device


def test_what_is_known_of_earlier_boots_only_after_a_calibration_or_a_rest_changes_neither(once: Stream) -> None:
    """It is looked up while samples go on, or again as the device is told another rate."""
    batches = once.batches()
    made, device = calibrated(batches)
    adopted = DeviceSession(NAME)
    feed(adopted, batches[: once.at(6.0) // 10], Remembered(replace(made, boot=7), None))
    assert adopted.applied.quality is Quality.BIAS_ONLY
    before = adopted.tracker.state
    adopted.moves(0.01)
    np.testing.assert_array_equal(adopted.tracker.bias, before.bias)
    np.testing.assert_array_equal(adopted.tracker.state.bias_cov, before.bias_cov)
    assert adopted.applied.model.scale_std.max() < 0.02
    adopted.adopt(Remembered(made, device.checkpoint()), made)
    applied = adopted.applied
    assert (applied.quality, applied.calibration) == (Quality.GOOD, made.id)
    adopted.moves(0.5)
    assert adopted.applied.same(applied)


def test_a_scale_that_is_heard_of_after_the_first_rest_is_what_gravity_is_turned_by(once: Stream) -> None:
    batches = once.batches()
    made, _ = calibrated(batches)
    late = DeviceSession(NAME)
    feed(late, batches[: once.at(6.0) // 10])
    before = late.tracker.state
    late.believe(replace(made, boot=7))
    late.moves(0.01)
    np.testing.assert_array_equal(late.tracker._model.matrix, made.matrix)
    np.testing.assert_array_equal(late.tracker.state.bias_cov, before.bias_cov)
    np.testing.assert_array_equal(late.tracker.bias, before.bias)


def test_a_doubt_stays_a_doubt(ward: Ward, once: Stream) -> None:
    ward.send(once.batches()[:-20], info(1))
    device = ward.service._devices[NAME]
    for doubted in (False, True):
        device.session.tracker.doubt.why = free("a jump") if doubted else ()
        ward.service._record.checkpoint(device, 0.0, force=True)
        remembered = ward.store.recall(NAME, 1, 1_700_000_000_000_000_000)
        assert remembered is not None
        resumed = DeviceSession(NAME)
        first = feed(resumed, once.batches()[-20:-18], remembered).corrected[0]
        status = resumed.status(1)
        assert first.quality is (Quality.DEGRADED if doubted else Quality.GOOD)
        assert status.state is (State.DEGRADED if doubted else State.TRACKING)
        assert (Code.BIAS_WAS_DOUBTED in codes(status.reason)) is doubted


@pytest.mark.parametrize("doubt", [(), free("a jump")], ids=["sure", "doubted"])
def test_the_bias_of_a_boot_without_a_calibration_goes_on(ward: Ward, once: Stream, doubt: Sentences) -> None:
    batches = once.batches()
    upto = once.at(6.0) // 10
    ward.send(batches[:upto], info(1))
    session = ward.service._devices[NAME].session
    assert session.status(1).quality is Quality.BIAS_ONLY
    session.tracker.doubt.why = doubt
    ward.service._record.checkpoint(ward.service._devices[NAME], 0.0, force=True)
    list(ward.subscriber)
    restart(ward)
    ward.send(batches[upto : upto + 2])
    last = list(ward.subscriber)[-1]
    assert last.quality is (Quality.NONE if doubt else Quality.BIAS_ONLY)
    np.testing.assert_allclose(last.bias, session.tracker.bias, atol=np.radians(0.02))


def test_a_calibration_of_a_time_to_come_is_used_where_there_is_no_other_and_it_is_said(
    ward: Ward, once: Stream, caplog: pytest.LogCaptureFixture
) -> None:
    of_boot_1 = DeviceSession(NAME)
    of_boot_1.info = info(1)
    feed(of_boot_1, once.batches(boot=1))
    made = of_boot_1.calibration
    assert made is not None
    ward.store.add_calibration(replace(made, time_ns=4_070_908_800 * 10**9))
    ward.send(second(once)[:30], info(2))
    status = ward.latest()
    assert status.quality is Quality.PRIOR
    assert status.events["calibration of a time to come"] == 1
    assert "the clock was wrong then, or is wrong now" in caplog.text


def test_an_estimator_that_is_stopped_and_started_goes_on_to_the_bit(tmp_path: Path, once: Stream) -> None:
    batches, rates = once.batches(), list[bytes]()
    for cut in (None, 30, len(batches) - 50):  # with turns of a calibration under way they would be taken again
        ward = Ward(tmp_path / str(cut))
        ward.send(batches[:cut], info())
        if cut is not None:
            ward.stop()
            ward.start()
            ward.send(batches[cut:], info())
        given = list(ward.subscriber.drain())
        rates.append(np.concatenate([batch.rate for batch in given]).tobytes())
        assert sum(map(len, given)) == len(once)
        ward.kill()
    assert rates[1] == rates[2] == rates[0]
