"""The service over the bus in memory, fed with a simulated device; its rounds are made by the test itself."""

import time
from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Note, Quality, State, Verdict
from estimator.device.batch_correction import Cut
from estimator.device.outcome import Outcome
from estimator.device.session import DeviceSession
from estimator.samples.sample_buffer import Samples
from tests.estimator.client.test_revision import revision
from tests.estimator.memory_ward import SILENCE_S, WARD, Ward
from tests.estimator.stream import NAME, Stream, calibration, info, rates
from tests.memory_bus import MemoryBus
from tests.sentences import codes, free

REVISION = revision()


@pytest.fixture(scope="module")
def once() -> Stream:
    return calibration(seed=1, after=[Still(1.0)])


@pytest.fixture(scope="module")
def other_boot() -> Stream:
    return calibration(seed=2)


def test_it_calibrates_stores_and_publishes(ward: Ward, once: Stream) -> None:
    ward.send(once.batches(), info(1))
    batches = list(ward.subscriber)
    np.testing.assert_array_equal(np.concatenate([b.ticks for b in batches]), once.ticks)
    assert batches[-1].quality is Quality.GOOD
    assert np.degrees(np.abs(rates(batches[-10:]) - once.rate[-len(rates(batches[-10:])) :])).max() < 0.2
    (published,) = ward.client.calibrations(wait_s=0.05)
    (stored,) = ward.store.calibrations(NAME)
    assert published.id == stored.id == batches[-1].calibration
    np.testing.assert_allclose(np.diag(stored.matrix), once.truth.k, atol=2e-4)
    assert (stored.model, stored.firmware, stored.verdict) == ("m", "1.0", Verdict.ACCEPTED)
    remembered = ward.store.recall(NAME, 1, 0)
    assert remembered is not None
    assert remembered.bias is not None
    status = ward.latest()
    assert (status.state, status.quality) == (State.TRACKING, Quality.GOOD)
    assert status.samples_in == status.samples_out == len(once)
    assert len(ward.client.calibrations(wait_s=0.05)) == 1, "logged once"


def test_a_reboot_asks_for_a_recalibration(ward: Ward, once: Stream, other_boot: Stream) -> None:
    ward.send(once.batches(), info(1))
    list(ward.subscriber)
    early = other_boot.batches(boot=2)
    ward.send(early[:15], info(2))
    after = list(ward.subscriber)
    assert {b.boot for b in after} == {2}
    assert {b.quality for b in after} == {Quality.PRIOR}, "the same hardware: its scale is a prior"
    assert Code.RESTARTED in codes(ward.latest().reason) or Code.HOLD_STILL in codes(ward.latest().reason)
    ward.send(once.batches(boot=1)[-5:])
    ward.send(early[15:])
    assert list(ward.subscriber)[-1].quality is Quality.GOOD
    assert len(ward.store.calibrations(NAME)) == 2
    status = ward.latest()
    assert status.dropped == {"old_boot": sum(map(len, once.batches()[-5:]))}
    assert status.samples_in == status.samples_out + sum(status.dropped.values())


def test_killed_and_restarted_the_same_boot_goes_on(ward: Ward, once: Stream) -> None:
    upto = once.at(once.time[-1] - 0.5) // 10
    batches = once.batches()
    ward.send(batches[:upto], info(1))
    before = list(ward.subscriber)
    assert before[-1].quality is Quality.GOOD
    ward.kill()
    ward.start()
    ward.send(batches[upto:])
    after = list(ward.subscriber)
    assert {b.quality for b in after} == {Quality.GOOD}
    assert {b.calibration for b in after} == {before[-1].calibration}
    assert ward.latest().state is State.TRACKING
    assert [c.id for c in ward.client.calibrations(wait_s=0.05)] == [before[-1].calibration], "said again for who joins"
    numbers = np.concatenate([b.sequence + np.arange(len(b)) for b in before + after])
    np.testing.assert_array_equal(numbers, np.arange(len(once)))
    assert ward.subscriber.repeated > 0, "the cached samples were corrected again"


def test_a_refused_calibration_is_published_but_not_kept(ward: Ward, monkeypatch: pytest.MonkeyPatch) -> None:
    from estimator.calibration import closure
    from estimator.calibration.result import NotConverged

    def never(*_: object) -> None:
        raise NotConverged(Code.TURNS_UNDETERMINED())

    monkeypatch.setattr(closure, "estimate", never)
    ward.send(calibration(seed=3).batches(), info(1))
    (published,) = ward.client.calibrations(wait_s=0.05)
    assert published.verdict is Verdict.REFUSED
    assert ward.store.calibrations(NAME) == []
    assert not any(b.quality is Quality.GOOD for b in ward.subscriber)


def test_revisions_are_published_after_what_they_revise(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    handle = DeviceSession.take
    batches = once.part(0, 260).batches()

    def revising(session: DeviceSession, batch: Samples, cuts: list[Cut]) -> Outcome | None:
        outcome = handle(session, batch, cuts)
        if batch.sequence == 230:
            outcome = outcome or Outcome()
            outcome.revisions += [replace(REVISION, device=NAME, reason=free(reason)) for reason in ("one", "another")]
        return outcome

    monkeypatch.setattr(DeviceSession, "take", revising)
    before = ward.client.revisions(idle_s=0.05)
    ward.send(batches, info())
    live, late = list(before), list(ward.client.revisions(NAME, idle_s=0.05))
    assert [one.reason for one in live] == [one.reason for one in late] == [free("one"), free("another")]
    np.testing.assert_array_equal(live[0].bias, REVISION.bias)


def test_what_is_not_understood_is_refused_and_harms_nobody(ward: Ward, once: Stream) -> None:
    batches = once.batches()
    ward.send(batches[:100], info(1))
    bad_gyro = batches[100].gyro.copy()
    bad_gyro[3] = np.nan
    ward.put(codec.encode_samples(replace(batches[100], gyro=bad_gyro)), bridge="bridge", device=NAME)
    ward.put(b"\x00\xff", bridge="bridge", device=NAME)
    ward.put(codec.encode_samples(batches[100]), bridge="bridge", device="other")
    ward.send(batches[100:])
    assert ward.service.counts.total("sample messages refused") == 3
    assert ward.service.counts.as_dict()["sample messages refused, non_finite"] == 1
    assert list(ward.subscriber)[-1].quality is Quality.GOOD
    assert set(ward.client.statuses(0.05)) == {NAME}


def test_commands_are_done_audited_and_explained(ward: Ward, once: Stream) -> None:
    ward.send(once.batches(), info(1))
    assert ward.command(lambda: ward.client.recalibrate(NAME, "nurse", "strap")).accepted
    assert ward.latest().state is State.AWAITING_STILL
    assert ward.command(lambda: ward.client.cancel(NAME, "nurse")).accepted
    assert ward.latest().state is State.TRACKING
    assert not ward.command(lambda: ward.client.cancel(NAME, "nurse")).accepted
    assert ward.command(lambda: ward.client.note(NAME, "nurse", "fell down")).message == (Code.NOTED(),)
    assert not ward.command(lambda: ward.client.note(NAME, "nurse", "")).accepted
    rows = ward.store.database.rows("audit")
    assert [(row["verb"], row["who"], row["accepted"]) for row in rows] == [
        ("recalibrate", "nurse", 1),
        ("cancel", "nurse", 1),
        ("cancel", "nurse", 0),
        ("note", "nurse", 1),
        ("note", "nurse", 0),
    ]


def test_commands_to_names_that_somebody_made_up_are_refused_counted_and_not_kept(
    ward: Ward, once: Stream, caplog: pytest.LogCaptureFixture
) -> None:
    early = ward.command(lambda: ward.client.note("nobody", "nurse", "hello"))
    assert early.message == (Code.UNKNOWN_DEVICE(device="nobody"),)
    ward.send(once.batches()[:20], info(1))
    for name in ("ghost-1", "ghost-2"):
        reply = ward.command(lambda name=name: ward.client.recalibrate(name, "nurse"))  # type: ignore[misc] # asked now
        assert not reply.accepted
        assert reply.message == (Code.UNKNOWN_DEVICE(device=name), Code.KNOWN_DEVICES(names=NAME))
    assert ward.store.database.rows("audit") == []
    assert ward.service._count_all()["commands to unknown devices"] == 3
    assert caplog.text.count("Unknown device") == 1
    assert ward.store.devices() == [NAME]


def test_a_note_is_published(ward: Ward, once: Stream) -> None:
    notes = MemoryBus(ward.broker).subscribe(keys.pattern(WARD, "note"))
    ward.send(once.batches()[:100], info(1))
    ward.command(lambda: ward.client.note(NAME, "nurse", "fell down"))
    ward.command(lambda: ward.client.note(NAME, "nurse", ""))
    ward.command(lambda: ward.client.cancel(NAME, "nurse", "no note"))
    assert [codec.decode_note(*message) for message in notes.drain(10, 0.1)] == [
        Note(NAME, 1, 1_700_000_000_000_000_000, "nurse", "fell down")
    ]


def test_a_silent_device_is_lost_but_not_while_the_router_is_gone(ward: Ward, once: Stream) -> None:
    ward.send(once.batches(), info(1))
    ward.broker.stop()
    ward.service._devices[NAME].heard -= SILENCE_S
    ward.service._every_second(time.monotonic())
    ward.service.work()
    assert ward.service._devices[NAME].status(1).state is State.UNKNOWN
    ward.broker.start()
    unknown = ward.latest()
    assert (unknown.state, codes(unknown.reason)[0]) == (State.UNKNOWN, Code.ROUTER_GONE)
    ward.send(once.batches()[-3:])
    assert ward.latest().state is State.UNKNOWN, "nothing of it was new"
    more = once.part(0, 20)
    ward.send(replace(more, ticks=once.ticks[-1] + more.ticks).batches(first=len(once)))
    assert ward.latest().state is State.TRACKING
    ward.service._devices[NAME].heard -= SILENCE_S
    lost = ward.latest()
    assert (lost.state, lost.quality) == (State.LOST, Quality.DEGRADED)
    assert Code.NO_SAMPLES in codes(lost.reason)
    ward.service._devices[NAME].heard -= 1200.0 - SILENCE_S
    later = ward.latest()
    assert (later.state, later.reason[0]) == (State.LOST, Code.NO_SAMPLES(duration="20 min"))
