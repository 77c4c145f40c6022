"""The life of one device, fed as the service feeds it."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bridge.sim.imperfection import ImuSpec
from bridge.sim.motion import Still
from bridge.sim.script import SessionPlan, TurnPlan, session, swing
from bridge.wire import codec, keys
from bridge.wire.messages import NO_REST_S, Quality, State, Verdict
from estimator.learnt import CANCELLED_S
from estimator.remembered import Remembered
from estimator.session import DeviceSession
from estimator.session_knobs import SessionKnobs
from estimator.track.doubt import DoubtKnobs
from estimator.track.tracker import TrackKnobs
from tests.estimator.stream import NAME, Stream, calibration, feed, info, rates, stream
from tests.estimator.track.worn import PLAIN, rest


def worn(seed: int, bursts: int = 6) -> list[object]:
    rng = np.random.default_rng(seed)
    return [p for _ in range(bursts) for p in (swing(rng, 3.0, np.radians(100.0)), Still(4.0))]


@pytest.fixture(scope="module")
def once() -> Stream:
    """Booted, calibrated within 30 s, then worn."""
    return calibration(seed=1, after=worn(1))  # type: ignore[arg-type]


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


# ---- from boot to tracking ----------------------------------------------------------------------------------------


def test_from_power_up_to_good(once: Stream) -> None:
    device = DeviceSession(NAME)
    device.info = info()
    seen: list[State] = []
    corrected = []
    for batch in once.batches():
        corrected += feed(device, [batch]).corrected
        if not seen or seen[-1] is not state(device):
            seen.append(state(device))
    assert seen == [State.WARMING, State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING, State.TRACKING]
    assert len(rates(corrected)) == len(once), "corrected from the first sample on"
    qualities = [b.quality for b in corrected]
    assert qualities[0] is Quality.NONE
    assert Quality.BIAS_ONLY in qualities
    assert qualities == sorted(qualities), "it only gets better"
    good = [b for b in corrected if b.quality is Quality.GOOD]
    assert good[0].device_time[0] < 31.0
    assert device.calibration is not None
    np.testing.assert_allclose(np.diag(device.calibration.matrix), once.truth.k, atol=2e-4)
    assert (device.calibration.model, device.calibration.firmware) == ("m", "1.0")
    error = rates(good).astype(float) - once.rate[-len(rates(good)) :]
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.06


def test_sequence_and_ticks_of_what_is_corrected_go_on_without_a_break(once: Stream) -> None:
    corrected = feed(DeviceSession(NAME), once.batches()).corrected
    numbers = np.concatenate([b.sequence + np.arange(len(b)) for b in corrected])
    np.testing.assert_array_equal(numbers, np.arange(len(once)))
    np.testing.assert_array_equal(np.concatenate([b.ticks for b in corrected]), once.ticks)
    assert all(codec.decode_corrected(keys.build("w", "corrected", device=NAME), codec.encode_corrected(b)).quality
               is b.quality for b in corrected)  # fmt: skip


@pytest.mark.parametrize("accel", [True, False])
@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 400.0])
def test_any_rate_with_and_without_an_accelerometer(rate_hz: float, accel: bool) -> None:
    of = calibration(seed=2, rate_hz=rate_hz)
    device = DeviceSession(NAME)
    outcome = feed(device, of.batches(list(range(8, len(of), 8)), accel=accel))
    assert outcome.calibration is not None
    np.testing.assert_allclose(np.diag(outcome.calibration.matrix), of.truth.k, atol=3e-4)
    assert device.status(1).rate_hz == pytest.approx(rate_hz, rel=1e-3)


def test_status_can_be_published_at_any_time(once: Stream) -> None:
    device = DeviceSession(NAME)
    key = keys.build("w", "status", device=NAME)
    assert codec.decode_status(key, codec.encode_status(device.status(1))).state is State.UNKNOWN
    for batch in once.batches(list(range(50, len(once), 50))):
        feed(device, [batch])
        status = codec.decode_status(key, codec.encode_status(device.status(1)))
        assert status.samples_in == status.samples_out + sum(status.dropped.values())
        assert 0 <= status.progress <= 1
        assert status.evidence_age_s >= 0
        if device.life.state in {State.UNKNOWN, State.WARMING}:
            assert status.evidence_age_s == NO_REST_S
    assert 0 <= status.evidence_age_s < 60
    assert status.progress == 1
    assert status.axes_done == ()
    np.testing.assert_allclose(status.scale, once.truth.k, atol=2e-4)


def test_the_words_say_what_is_missing() -> None:
    of = calibration(TurnPlan(1), TurnPlan(0, 180.0), seed=3)
    device = DeviceSession(NAME)
    outcome = feed(device, of.batches())
    assert state(device) is State.TURNING
    assert any("turn about y taken; still needed: x, z" in words for words in outcome.said)
    assert "still needed: x, z" in device.life.reason
    assert device.status(1).axes_done == (1,)


def test_a_calibration_that_fails_is_told_and_fits_the_wire(monkeypatch: pytest.MonkeyPatch) -> None:
    from estimator.batch import closure

    def never(*_: object) -> None:
        raise closure.NotConverged("no scale factors close the three turns")

    monkeypatch.setattr(closure, "estimate", never)
    device = DeviceSession(NAME)
    outcome = feed(device, calibration(seed=4).batches())
    assert state(device) is State.TURNING
    assert device.calibration is None
    assert outcome.calibration is not None
    assert outcome.calibration.verdict is Verdict.REFUSED
    key = keys.build("w", "calibration", device=NAME)
    assert codec.decode_calibration(key, codec.encode_calibration(outcome.calibration)).parameters == ()
    assert not any(b.quality is Quality.GOOD for b in outcome.corrected)


# ---- boots --------------------------------------------------------------------------------------------------------


def test_after_a_reboot_not_one_sample_is_good(once: Stream) -> None:
    device = calibrated(once)
    rebooted = feed(device, calibration(TurnPlan(0), seed=9).batches(boot=2))
    assert rebooted.corrected[0].boot == 2
    assert not any(b.quality in (Quality.GOOD, Quality.DEGRADED) for b in rebooted.corrected)
    assert device.status(1).calibration == ""
    assert any("recalibration needed" in words for words in rebooted.said)


def test_a_reboot_in_the_middle_of_a_turn_forgets_the_turns(once: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, once.part(0, once.at(17.0)).batches(boot=1))
    assert device.status(1).axes_done != ()
    feed(device, calibration(TurnPlan(2), seed=9).batches(boot=2))
    assert device.status(1).axes_done == (2,)
    assert state(device) is State.TURNING


def test_late_samples_of_the_old_boot_are_dropped_and_counted(once: Stream) -> None:
    device = calibrated(once)
    fresh = calibration(seed=9).batches(boot=2)
    feed(device, fresh[:50])
    late = feed(device, once.batches(boot=1)[-5:])
    assert late.corrected == []
    assert device.boot == 2
    status = device.status(1)
    assert status.dropped["old_boot"] == sum(map(len, once.batches()[-5:]))
    # And they change nothing in what comes after.
    undisturbed = calibrated(once)
    expected = feed(undisturbed, fresh).corrected[-len(fresh) + 60 :]
    np.testing.assert_array_equal(rates(feed(device, fresh[50:]).corrected)[-200:], rates(expected)[-200:])


def test_an_earlier_boots_scale_is_a_prior_until_the_first_calibration(once: Stream) -> None:
    old = calibrated(once).calibration
    assert old is not None
    device = DeviceSession(NAME)
    outcome = feed(device, calibration(seed=1, before_s=2.0).batches(boot=2), Remembered(old, None))
    first = outcome.corrected[0]
    assert first.quality is Quality.PRIOR
    assert first.calibration == old.id
    assert (first.bias_std > np.radians(1.0)).all(), "a turn-on bias is not repeated"
    resting = [b for b in outcome.corrected if b.quality is Quality.BIAS_ONLY]
    assert (resting[0].scale_std >= 0.02).all()
    assert (resting[0].bias_std < np.radians(0.25)).all(), "a second says something"
    assert (resting[-1].bias_std < np.radians(0.07)).all(), "some rests say more"
    last = outcome.corrected[-1]
    assert last.quality is Quality.GOOD
    assert last.calibration != old.id


def test_the_same_boot_is_restored_at_once(once: Stream) -> None:
    half = once.at(32.0)
    device = DeviceSession(NAME)
    feed(device, once.part(0, half).batches())
    assert device.calibration is not None
    remembered = Remembered(device.calibration, device.checkpoint())
    rest = once.part(half, len(once)).batches(first=half)
    resumed = DeviceSession(NAME)
    outcome = feed(resumed, rest, remembered)
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)
    assert resumed.life.state is State.TRACKING
    expected = feed(device, rest)
    np.testing.assert_allclose(rates(outcome.corrected), rates(expected.corrected), atol=np.radians(0.01))


@pytest.mark.parametrize("later_s", [0.0, -4295.0])
def test_restored_without_knowing_since_when_it_waits_for_a_rest(once: Stream, later_s: float) -> None:
    """The checkpoint is damaged, or the device's clock has gone round while nobody looked."""
    device = calibrated(once)
    bias = device.checkpoint()
    assert device.calibration is not None
    assert bias is not None
    remembered = Remembered(device.calibration, None if later_s == 0 else replace(bias, time=bias.time - later_s))
    more = replace(once, ticks=once.ticks + 2_000_000_000)
    if later_s:
        remembered = Remembered(device.calibration, replace(bias, time=2000.0 - later_s))
    resumed = DeviceSession(NAME)
    outcome = feed(resumed, more.part(0, 600).batches(first=9000), remembered)
    assert outcome.corrected[0].quality is Quality.DEGRADED
    assert outcome.corrected[-1].quality is Quality.GOOD
    assert resumed.status(1).evidence_age_s >= 0


def test_of_a_boot_of_which_nothing_came_nothing_is_kept(once: Stream) -> None:
    device = calibrated(once)
    assert device.calibration is not None
    resumed = DeviceSession(NAME)
    resumed.begin_boot(1, 30.0, Remembered(device.calibration, device.checkpoint()))
    assert resumed.checkpoint() is None
    feed(resumed, once.batches()[-2:])
    assert resumed.checkpoint() is not None


def test_a_clock_that_goes_back_goes_on(once: Stream) -> None:
    """A bridge that was restarted 71 minutes after the device counts the 32 bits of its ticks from anew."""
    wrapped = 2**32
    late = replace(once, ticks=once.ticks + wrapped)
    half = late.at(late.time[0] + 40.0)
    device = DeviceSession(NAME)
    feed(device, late.part(0, half).batches())
    assert state(device) is State.TRACKING
    after = late.part(half, len(late))
    before = device.tracker.doubt.last_receipt
    outcome = feed(device, replace(after, ticks=after.ticks - wrapped).batches(first=half))
    assert device.status(1).events["device clock went back"] == 1
    assert device.tracker.doubt.last_receipt is not before, "rests are recognised as before"
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)
    np.testing.assert_array_equal(outcome.corrected[0].ticks, after.ticks[: len(outcome.corrected[0])] - wrapped)


# ---- doubt --------------------------------------------------------------------------------------------------------


def off(of: Stream, dps: float, seconds: float) -> Stream:
    """The device goes on resting, but reads this much more."""
    more = stream([Still(seconds)], seconds, seed=77, attitude=of.attitude[-1])
    gyro = more.gyro - more.bias + of.bias[0] + np.radians([0.0, 0.0, dps])
    warm = np.full(len(more), of.temperature_c[-1])
    return replace(more, ticks=more.ticks + of.ticks[-1], gyro=gyro, temperature_c=warm)


def test_a_bias_that_jumps_is_doubted_then_learnt(once: Stream) -> None:
    device = calibrated(once)
    n = len(once)
    first = off(once, 0.6, 20.0)
    outcome = feed(device, first.batches(first=n))
    assert outcome.corrected[-1].quality is Quality.DEGRADED
    assert state(device) is State.DEGRADED
    (said,) = re.findall(r"at rest it reads (.*) °/s off", device.life.reason)
    assert float(said) == pytest.approx(0.6, abs=0.05)
    more = off(first, 0.0, 130.0)
    more = replace(more, gyro=more.gyro + first.gyro.mean(axis=0) - more.gyro.mean(axis=0))
    outcome = feed(device, more.batches(first=n + len(first)))
    assert np.abs(np.degrees(rates(outcome.corrected[-50:]).mean(axis=0))).max() < 0.05, "learnt at last"
    assert state(device) is State.DEGRADED, "but it may be turning still"
    moved = stream([swing(np.random.default_rng(0), 3.0, 1.0), Still(15.0)], 18.0, seed=78)
    bias = first.gyro.mean(axis=0)
    ticks = moved.ticks + more.ticks[-1] + 1_000_000  # a gap: it goes on in another pose
    moved = replace(moved, ticks=ticks, gyro=moved.gyro - moved.bias + bias)
    moved = replace(moved, temperature_c=np.full(len(moved), more.temperature_c[-1]))
    outcome = feed(device, moved.batches(first=n + len(first) + len(more)))
    assert state(device) is State.TRACKING, "the same at another rest: it was the bias"
    assert outcome.corrected[-1].quality is Quality.GOOD


def test_a_slow_turn_of_a_minute_is_not_swallowed(once: Stream) -> None:
    device = calibrated(once)
    k = once.truth.k[2]
    outcome = feed(device, off(once, 0.3 / k, 60.0).batches(first=len(once)))
    seen = np.degrees(rates(outcome.corrected)[:, 2].astype(float)).sum() / 104.0
    assert seen == pytest.approx(18.0, abs=0.6)


def test_asking_for_a_recalibration_makes_no_doubt_go_away(once: Stream) -> None:
    device = calibrated(once)
    doubtful = off(once, 0.6, 20.0)
    feed(device, doubtful.batches(first=len(once)))
    assert state(device) is State.DEGRADED
    assert device.recalibrate("nurse", "") is None
    moving = calibration(TurnPlan(0), seed=1, before_s=0.0, plan=SessionPlan(0.2, (TurnPlan(0, swing=True),)))
    going_on = replace(moving, ticks=moving.ticks + doubtful.ticks[-1])
    outcome = feed(device, going_on.batches(first=len(once) + len(doubtful)))
    assert all(b.quality is Quality.DEGRADED for b in outcome.corrected)
    assert device.cancel("nurse") is None
    assert state(device) is State.DEGRADED
    assert device.status(1).quality is Quality.DEGRADED


def test_a_new_calibration_ends_a_doubt_at_once(once: Stream) -> None:
    device = calibrated(once)
    doubtful = off(once, 0.6, 20.0)
    feed(device, doubtful.batches(first=len(once)))
    assert device.recalibrate("nurse", "") is None
    more = again(once)
    more = replace(
        more, ticks=more.ticks + doubtful.ticks[-1] - once.ticks[-1], gyro=more.gyro + np.radians([0, 0, 0.6])
    )
    outcome = feed(device, more.batches(first=len(once) + len(doubtful)))
    assert outcome.calibration is not None
    new = [b for b in outcome.corrected if b.calibration == outcome.calibration.id]
    old = [b for b in outcome.corrected if b.calibration != outcome.calibration.id]
    assert {b.quality for b in old} == {Quality.DEGRADED}
    assert {b.quality for b in new} == {Quality.GOOD}


def test_without_rest_the_uncertainty_grows_and_is_degraded_at_last(once: Stream) -> None:
    """As far as the bias walks by itself: at an even temperature, what is not known of warmth would hide it."""
    knobs = SessionKnobs(track=TrackKnobs(doubt=DoubtKnobs(evidence_age_s=60.0)))
    device = DeviceSession(NAME, knobs)
    feed(device, replace(once, temperature_c=np.full(len(once), 30.0)).batches())
    rng = np.random.default_rng(0)
    busy = [swing(rng, 5.0, np.radians(120.0)) for _ in range(20)]
    moving = stream(busy, 99.0)
    even = np.full(len(moving), 30.0)
    moving = replace(moving, ticks=moving.ticks + once.ticks[-1], temperature_c=even, truth=once.truth)
    # Another device's gyro moves: gravity would not agree with it.
    corrected = feed(device, moving.batches(first=len(once), accel=False)).corrected
    stds = np.array([b.bias_std.max() for b in corrected])
    assert stds[-1] > 1.5 * stds[0]
    # Deviations are those of corrected rates: the axis with the largest scale factor.
    walk = knobs.track.bias.rate_random_walk * np.sqrt(99.0) * once.truth.k.max()
    assert np.sqrt(stds[-1] ** 2 - stds[0] ** 2) == pytest.approx(walk, rel=0.1)
    assert corrected[0].quality is Quality.GOOD
    assert corrected[-1].quality is Quality.DEGRADED
    assert "no rest for" in device.life.reason


def test_pauses_too_short_for_a_rest_do_not_end_the_doubt_that_there_was_none() -> None:
    """Each confirmed the bias, which was doubted again a moment later: of who walked, seventy times in ten minutes."""
    rng = np.random.default_rng(0)
    walk = [piece for _ in range(12) for piece in (swing(rng, 5.0, np.radians(120.0)), Still(2.0))]
    device = DeviceSession(NAME, SessionKnobs(track=TrackKnobs(doubt=DoubtKnobs(evidence_age_s=30.0))))
    said = feed(device, calibration(seed=1, after=[*walk, Still(10.0)]).batches()).said
    states = [words.split(":")[0] for words in said if " -> " in words]
    assert states[-3:] == ["TURNING -> TRACKING", "TRACKING -> DEGRADED", "DEGRADED -> TRACKING"]


def test_a_lost_device_is_not_good_and_comes_back(once: Stream) -> None:
    device = calibrated(once.part(0, once.at(40.0)))
    assert device.silence("no samples for 3 s")
    assert not device.silence("no samples for 4 s"), "no news"
    assert device.status(1).reason == "no samples for 4 s"
    assert (device.status(1).state, device.status(1).quality) == (State.LOST, Quality.DEGRADED)
    assert device.recalibrate("nurse", "") is not None
    start = once.at(43.0)
    outcome = feed(device, once.part(start, len(once)).batches(first=start))
    assert outcome.said[0] == "heard again"
    assert state(device) is State.TRACKING
    assert outcome.corrected[-1].quality is Quality.GOOD
    assert device.status(1).events["missing_samples"] == start - once.at(40.0)


# ---- people -------------------------------------------------------------------------------------------------------


def test_nothing_to_recalibrate_before_it_is_heard() -> None:
    device = DeviceSession(NAME)
    assert "unknown" in (device.recalibrate("nurse", "") or "")
    assert "no calibration is under way" in (device.cancel("nurse") or "")


def test_the_old_calibration_stays_in_use_until_the_new_one(once: Stream) -> None:
    device = calibrated(once)
    old = device.calibration
    assert old is not None
    assert device.recalibrate("nurse", "new strap") is None
    assert "nurse: new strap" in device.life.reason
    more = again(once)
    outcome = feed(device, more.batches(first=len(once)))
    assert outcome.calibration is not None
    assert outcome.calibration.who == "nurse"
    assert outcome.calibration.id != old.id
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)
    used = [b.calibration for b in outcome.corrected]
    assert used == [old.id] * used.count(old.id) + [outcome.calibration.id] * used.count(outcome.calibration.id)
    assert used[-1] == outcome.calibration.id
    np.testing.assert_allclose(np.diag(outcome.calibration.matrix), once.truth.k, atol=3e-4)


@pytest.mark.parametrize("after_s", [0.0, 31.0, 34.0, 40.0, 44.0])
def test_cancelled_at_any_stage_the_old_one_stays(once: Stream, after_s: float) -> None:
    device = calibrated(once)
    old = device.calibration
    device.recalibrate("nurse", "")
    more = again(once)
    batches = more.batches(first=len(once))
    upto = int(after_s * 104 / 10)
    feed(device, batches[:upto])
    assert state(device) is not State.TRACKING
    assert device.cancel("nurse") is None
    assert device.cancel("nurse") is not None, "once is enough"
    assert state(device) is State.TRACKING
    outcome = feed(device, batches[upto:])
    assert outcome.calibration is None, "turns after that are movement"
    assert device.calibration is old
    assert all(b.quality is Quality.GOOD for b in outcome.corrected)


@pytest.mark.parametrize("doubt", ["", "no rest for 31 minutes"])
def test_that_it_was_cancelled_is_said_for_a_minute(once: Stream, doubt: str) -> None:
    device = calibrated(once)
    device.tracker.doubt.why = doubt
    device.recalibrate("nurse", "")
    device.cancel("nurse")
    cancelled = "calibration cancelled by nurse; the old one stays"
    batches = again(once, rest_s=70.0).batches(first=len(once)) if not doubt else shaken(once).batches(first=len(once))
    at = [batch.device_time[-1] - once.time[-1] for batch in batches]
    told = [(feed(device, [batch]).changed, device.life.reason) for batch in batches]
    back = next(n for n, (_, reason) in enumerate(told) if reason != cancelled)
    assert CANCELLED_S <= at[back] < CANCELLED_S + 2.0
    assert told[back] == (True, doubt or "calibrated; the calibration of this boot goes on")
    assert state(device) is (State.DEGRADED if doubt else State.TRACKING)


def test_what_was_said_since_a_cancel_stays(once: Stream) -> None:
    device = calibrated(once)
    device.recalibrate("nurse", "")
    device.cancel("nurse")
    device.recalibrate("another nurse", "new strap")
    feed(device, shaken(once).batches(first=len(once)))
    assert device.life.reason.startswith("recalibration asked for by another nurse: new strap")


def test_cancelled_before_there_was_any_it_starts_over(once: Stream) -> None:
    device = DeviceSession(NAME)
    feed(device, once.part(0, once.at(17.0)).batches())
    assert state(device) is State.TURNING
    assert device.cancel("nurse") is None
    assert (state(device), device.status(1).axes_done) == (State.AWAITING_STILL, ())


def test_who_asked_is_not_remembered_beyond_a_boot(once: Stream) -> None:
    device = calibrated(once)
    device.recalibrate("nurse", "")
    outcome = feed(device, calibration(seed=9).batches(boot=2))
    assert outcome.calibration is not None
    assert outcome.calibration.who == ""


# ---- a damaged stream ---------------------------------------------------------------------------------------------


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
