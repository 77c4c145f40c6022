"""What outlives a restart: of the estimator, of the device, and of a device that is not what it was."""

import logging
from dataclasses import replace
from typing import Any

import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire.messages import Calibration, Quality, SampleBatch, State
from estimator.device.session import DeviceSession
from estimator.service import history
from estimator.service.store_access import SCRATCH
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, calibration, feed, info
from tests.sentences import codes, free

OTHERS: list[tuple[dict[str, Any], str]] = [
    ({"firmware": "2.0"}, "The firmware is 2.0; it was 1.0"),
    ({"model": "n"}, "The model is n; it was m"),
    ({"gyro_range": 4.36}, "The full-scale range is 4.36 rad/s. The calibration was made at 8.7 rad/s"),
    ({"rate_hz": 208.0, "has_clock": False}, "The sample rate is 208 Hz. The calibration was made at 104 Hz"),
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


def test_a_power_up_under_the_same_boot_number_is_not_good_after_a_restart_either(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr("estimator.service.run_loop.time.monotonic", lambda: now[0])
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


def calibrated(batches: list[SampleBatch]) -> tuple[Calibration, DeviceSession]:
    device = DeviceSession(NAME)
    feed(device, batches)
    assert device.calibration is not None
    return device.calibration, device


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
