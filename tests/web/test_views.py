"""The pure parts: what is made of messages, with time as an argument."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence
from bridge.wire.messages import NO_REST_S, BiasRevision, CorrectedBatch, Quality, SampleBatch, State, Status
from estimator.guide.guide import Guide
from estimator.language.texts import texts
from estimator.web import number_format
from estimator.web.device_page import device_page
from estimator.web.device_trail import POINTS, Trail
from estimator.web.guide_view import guide_view
from estimator.web.heading_drift import Heading
from estimator.web.reports import past, summary
from estimator.web.tiles import ward_page
from estimator.web.traces import ALONE_S, Traces
from estimator.web.ward_state import FORGET_S, LOOKED_S, STRANGERS, Known
from tests.estimator.device.test_correction import CALIBRATION
from tests.web.talk import about, said

S = 10**9
GONE = english(Code.ROUTER_GONE())
EN = texts("en")
NOW = 1_800_000_000 * S


def known(*messages: object) -> Known:
    made = Known("w")
    made.connected = True
    for message in messages:
        (made.take_status(message, 100.0) if hasattr(message, "state") else made.take_info(message))  # type: ignore[arg-type]
    return made


# ---- tiles ----------------------------------------------------------------------------------------------------------


def test_of_several_bridges_that_tell_of_a_device_the_one_counts_whose_samples_are_taken() -> None:
    ward = known(about("a", bridge="b1", boot=1), said("a", boot=1, bridge="b1"))
    ward.take_info(about("a", bridge="b2", boot=9, model="other"))
    story = ward.stories["a"]
    assert story.info is not None
    assert (story.info.bridge, list(story.boots)) == ("b1", [1])
    assert (story.hears("b1"), story.hears("b2")) == (True, False)
    ward.take_status(said("a", State.UNKNOWN, boot=0, bridge="b2"), 100.5)
    assert story.hears("b1"), "of one that is not let in nobody's samples are taken"
    ward.take_status(said("a", boot=9, bridge="b2"), 101.0)
    ward.take_info(about("a", bridge="b2", boot=9))
    assert (story.info.bridge, list(story.boots)) == ("b2", [1, 9])


@pytest.mark.parametrize(
    ("state", "reason", "explained", "calibrate"),
    [
        (State.AWAITING_STILL, (Code.HOLD_STILL(),), "", "Calibrate"),
        (State.BIAS_ONLY, (Code.TURN_NOW(axes="x, y, z"),), "", "Calibrate"),
        (State.AWAITING_STILL, (Code.RECALIBRATION_ASKED(who="nurse"), Code.HOLD_STILL()),
         "nurse asked for a new calibration.", "Calibrate"),
        (State.TURNING, (Code.TURN_TAKEN(axis="x"),), "The turn about x was accepted.", "Calibrate"),
        (State.WARMING, (Code.RESTARTED(),), "", ""),
        (State.DEGRADED, (Code.NO_REST_FOR(minutes="12"),), "The device has not rested for 12 minutes.", ""),
    ],
)  # fmt: skip
def test_a_tile_gives_one_order(state: State, reason: tuple[Sentence, ...], explained: str, calibrate: str) -> None:
    (tile,) = ward_page(known(said("a", state, reason=reason)), 100.0, NOW, EN).tiles
    assert (tile.reason, tile.calibrate) == (explained, calibrate)


_HALF = (Code.TURN_TOO_SHORT(angle_deg="153"), Code.TURNS_NEEDED(axes="x, y"))


@pytest.mark.parametrize(
    ("state", "reason", "done", "advice", "guide"),
    [
        (State.BIAS_ONLY, (Code.TURN_NOW(axes="x, y, z"),), (), "Calibrate it with three turns.", "Calibrate"),
        (State.BIAS_ONLY, _HALF, (), "Again: one whole turn. 0 of 3 turns are done.", "Go on"),
        (State.TURNING, _HALF, (2,), "Again: one whole turn. 1 of 3 turns are done.", "Go on"),
        (State.TURNING, (Code.TURN_TAKEN(axis="x"), Code.TURNS_NEEDED(axes="y"), *_HALF[:1]), (0, 2),
         "Go on turning it: 2 of 3 turns are done.", "Go on"),
    ],
)  # fmt: skip
def test_the_order_after_a_failed_turn_is_to_repeat_it(
    state: State, reason: tuple[Sentence, ...], done: tuple[int, ...], advice: str, guide: str
) -> None:
    page = device_page(known(said("a", state, reason=reason, axes_done=done)), "a", 100.0, NOW, EN)
    assert (page.tile.advice, page.guide) == (advice, f"{guide}, step by step")


def test_a_tile_names_the_axes_that_are_done_and_has_no_riddle_for_none() -> None:
    def turns(*done: int) -> str:
        (tile,) = ward_page(known(said("a", State.TURNING, axes_done=done)), 100.0, NOW, EN).tiles
        return tile.turns

    assert (turns(), turns(0, 2)) == ("", "(x, z done)")


@pytest.mark.parametrize(
    ("status", "calibrate", "recalibrate", "cancel"),
    [
        (said("a", State.AWAITING_STILL), True, False, False),
        (said("a", State.AWAITING_STILL, calibrated_time_ns=1), True, False, True),
        (said("a", State.TURNING, axes_done=(1,)), True, False, True),
        (said("a", State.WARMING), True, False, False),
        (said("a"), True, True, False),
        (said("a", State.DEGRADED), True, True, False),
        (said("a", State.LOST), False, False, False),
    ],
)
def test_a_device_page_offers_only_what_can_be_done(
    status: Status, calibrate: bool, recalibrate: bool, cancel: bool
) -> None:
    page = device_page(known(status), "a", 100.0, NOW, EN)
    assert (page.can_calibrate, page.can_recalibrate, page.can_cancel) == (calibrate, recalibrate, cancel)


def test_a_report_tells_why_a_device_that_tracks_needs_a_person() -> None:
    (need,) = summary(known(said("a"), about("a", battery_percent=9.0)), 100.0, EN)["needs"]
    assert (need["advice"], need["reason"]) == ("Charge its battery.", "The battery is at 9 %: charge the device.")
    (need,) = summary(known(said("a", State.BIAS_ONLY, reason=(Code.TURN_NOW(axes="x"),))), 100.0, EN)["needs"]
    assert (need["advice"], need["reason"]) == ("Calibrate it with three turns.", "")


@pytest.mark.parametrize(
    ("state", "following", "how"),
    [
        (State.TRACKING, "b", "It is ready: nothing to do."),
        (State.DEGRADED, "", "Lay it down still for a moment."),
        (State.LOST, "", "Check that it is on, charged and near. If it stays silent, tell the engineer."),
    ],
)
def test_a_guide_leads_on_once_a_device_is_exact(state: State, following: str, how: str) -> None:
    ward, guide = known(said("a", state), said("b", State.AWAITING_STILL)), Guide()
    guide.take_status(said("a", state))
    view = guide_view(guide.told(), ward, "a", 100.0)
    assert (view.following, view.say["en"].how) == (following, how)


def test_a_bias_and_its_unit_stay_on_one_line() -> None:
    assert number_format.bias((0.01, 0.0, -0.01), (0.001,) * 3).endswith(
        " −0.57 ±\N{NO-BREAK SPACE}0.11\N{NO-BREAK SPACE}°/s"
    )


def test_a_device_nobody_speaks_of_any_more_is_silent() -> None:
    (tile,) = ward_page(known(said("a")), 110.0, NOW, EN).tiles
    assert (tile.state, tile.tone) == ("silent", "bad")
    assert "10 s" in tile.reason
    assert ward_page(known(said("a")), 100.0, NOW, EN).tiles[0].stale == ""
    for ahead_s in (-3600, 3600):  # by the estimator's clock; when it was heard is a matter of our own
        ward = known(said("a", time_ns=NOW + ahead_s * S), said("a", time_ns=NOW + ahead_s * S + 1))
        assert ward_page(ward, 110.0, NOW, EN).tiles[0].stale == "numbers as of 10 s ago"


def test_without_a_router_a_device_is_unknown_and_never_gone() -> None:
    ward = known(said("a"), said("b", State.LOST), about("c"))
    ward.connected = False
    page = ward_page(ward, 500.0, NOW, EN)
    assert {tile.id: (tile.state, tile.reason) for tile in page.tiles} == {
        "a": ("unknown", f"{GONE} The last known state of the device: tracking."),
        "b": ("unknown", f"{GONE} The last known state of the device: lost."),
        "c": ("unknown", GONE),
    }
    assert page.troubles == [english(Code.WARD_ROUTER_GONE())]
    ward.connected = True
    assert {tile.state for tile in ward_page(ward, 100.0, NOW, EN).tiles} == {"tracking", "lost", "unknown"}


def test_a_ward_where_no_estimator_has_shown_itself_is_deaf() -> None:
    ward = known(about("a", bridge="b"))
    ward.alive["bridge"]["b"] = True
    ward.take_router(100.0, there=True)
    assert not ward.deaf("a"), "who is there may be slow to show it"
    assert not ward.broken("a", 100.0)
    ward.take_router(101.0 + LOOKED_S, there=True)
    assert ward.broken("a", 101.0 + LOOKED_S)
    ward.alive["estimator"]["e"] = True
    assert not ward.broken("a", 101.0 + LOOKED_S)


def test_devices_that_only_a_bridge_speaks_of_hide_nobody_and_are_said() -> None:
    ward = known(*(about(f"d{i}", bridge="ghost") for i in range(STRANGERS + 3)), said("z"), about("z"))
    page = ward_page(ward, 100.0, NOW, EN)
    assert len(page.tiles) == STRANGERS + 1
    assert "z" in {tile.id for tile in page.tiles}
    assert any("too many devices. 3" in words and "too many: ghost." in words for words in page.troubles)


def test_a_device_with_a_status_takes_the_place_of_one_that_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("estimator.web.ward_state.DEVICES", 3)
    ward = known(said("a"), about("b"), about("c"), said("d"), said("e"), said("f"))
    assert [(name, story.number) for name, story in ward.stories.items()] == [("a", 0), ("d", 1), ("e", 2)]
    assert ward.left_out.as_dict() == {"devices": 1}


def test_a_device_without_a_calibration_is_forgotten_once_the_estimator_speaks_of_others_alone() -> None:
    ward = known(said("a"), said("b", calibration="c"), said("ghost"), about("ghost"))
    ward.tidy(100.0 + FORGET_S + 1.0)
    assert len(ward.stories) == 3, "nothing comes of anybody: the estimator is gone, not the devices"
    ward.take_status(said("a"), 100.0 + FORGET_S)
    ward.tidy(100.0 + FORGET_S + 1.0)
    assert {name: story.number for name, story in ward.stories.items()} == {"a": 0, "b": 1}
    assert {row.device for row in ward.rows(300.0)} == {"a", "b"}


def test_devices_that_no_live_bridge_lists_cost_little_and_are_forgotten() -> None:
    tracemalloc.start()
    ward = known(*(about(f"d{i}", bridge="ghost") for i in range(STRANGERS - 1)), about("new", bridge="one"))
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert size / STRANGERS < 10_000
    for n in range(3000):
        ward.take_token("bridge", f"ghost-{n}", alive=n % 2 == 0)
    ward.take_token("bridge", "one", alive=True)
    ward.tidy(100.0)
    assert len(ward.stories) == STRANGERS
    ward.tidy(101.0 + FORGET_S)
    assert set(ward.stories) == {"new"}
    assert len(ward.alive["bridge"]) < 2000


@pytest.mark.parametrize(
    ("model", "told", "shown"),
    [
        ("Movella DOT", "", "factory-calibrated, from the device"),
        ("Movella DOT", "mpu-6050", "mpu-6050, from the ward file"),
        ("WitMotion", "", "generic: no model is known"),
    ],
)
def test_a_device_page_tells_whence_the_noise_model_is(model: str, told: str, shown: str) -> None:
    facts = dict(device_page(known(about("a", model=model)), "a", 100.0, NOW, EN, told).facts)
    assert facts["noise model"] == shown


@pytest.mark.parametrize(("sigmas", "moved"), [(3.8, ""), (4.1, "y")])
def test_two_methods_whose_intervals_exclude_each_other_say_that_the_bias_moved(sigmas: float, moved: str) -> None:
    ward = known(about("a", boot=CALIBRATION.boot), said("a", boot=CALIBRATION.boot))
    std = float(np.sqrt(CALIBRATION.covariance[1, 1]))
    later = replace(
        CALIBRATION, id="later", method="turn360", time_ns=CALIBRATION.time_ns + S,
        bias=CALIBRATION.bias + np.array([0.0, sigmas * std, 0.0]),
    )  # fmt: skip
    for one in (CALIBRATION, later, replace(later, id="other", boot=9, time_ns=later.time_ns + S)):
        ward.take_calibration(replace(one, device="a"))
    other, of_later, first = (cells[-1] for _, cells in device_page(ward, "a", 100.0, NOW, EN).calibrations)
    said_so = f"The bias has moved since the calibration before: {moved}."
    assert (said_so in of_later) is bool(moved)
    assert "moved" not in first + other


def test_a_picture_of_the_past_shows_the_boot_from_which_on_the_bias_was_unsure() -> None:
    ward = known(about("a", boot=4, time_ns=NOW - 7200 * S), about("a", boot=5, time_ns=NOW - S))
    for i, std in enumerate([0.5, 0.5, 0.001, 0.001]):
        ward.take_status(said("a", boot=5, time_ns=NOW + i * S, bias_std=(std, std, std)), 100.0 + i)
    drawn = past(ward.stories["a"], "a")
    assert list(drawn.biases[0].time_ns) == [NOW + 2 * S, NOW + 3 * S]
    assert list(drawn.boots) == [{"time_ns": NOW - S}], "an earlier one is of a time of which nothing is shown"


# ---- what a trail keeps -----------------------------------------------------------------------------------------------


def test_a_trail_is_bounded_and_keeps_the_ends() -> None:
    trail = Trail()
    for i in range(5 * POINTS):
        trail.take(said("a", boot=1, time_ns=NOW + i * S, bias=(float(i), 0.0, 0.0)))
    assert POINTS / 2 < len(trail.points) <= POINTS
    assert trail.points[0, 0] == 0.0
    assert trail.points[-1, 0] == 5 * POINTS - 1
    assert np.all(np.diff(trail.times_ns) > 0)
    trail.take(said("a", boot=1, time_ns=NOW))
    assert trail.points[-1, 0] == 5 * POINTS - 1


def test_rests_are_told_by_the_age_of_evidence() -> None:
    trail = Trail()
    for i, age_s in enumerate([0.2, 0.2, 0.2, 1.2, 2.2, 3.2, 4.2, 5.2, 0.2, 0.2]):
        trail.take(said("a", boot=1, time_ns=NOW + i * S, evidence_age_s=age_s))
    assert [(round((a - NOW) / S, 1), round((b - NOW) / S, 1)) for a, b in trail.rests] == [(-1.2, 1.8), (6.8, 8.8)]
    never = Trail()
    never.take(said("a", boot=1, time_ns=NOW, evidence_age_s=NO_REST_S))
    assert not never.rests


def test_boots_and_refused_evidence_are_marked() -> None:
    trail = Trail()
    trail.take(said("a", boot=1, time_ns=NOW, events={"zaru: it tilts": 1, "gaps": 1}))
    trail.take(said("a", boot=1, time_ns=NOW + S, events={"zaru: it tilts": 2, "gaps": 5}))
    trail.take(said("a", boot=2, time_ns=NOW + 2 * S, events={"zaru: it tilts": 9}))
    assert [(mark.kind, mark.words) for mark in trail.marks] == [
        ("refused", "zaru: it tilts"),
        ("boot", "started anew"),
    ]


def test_a_revision_changes_the_past_it_covers() -> None:
    trail = Trail()
    for i in range(10):
        trail.take(said("a", boot=1, time_ns=NOW + i * S))
    times = np.array([NOW + 2 * S, NOW + 4 * S])
    bias, std = np.array([[1, 1, 1], [3, 3, 3]], np.float32), np.full((2, 3), 0.5, np.float32)
    trail.revise(BiasRevision("a", 1, "", NOW, np.eye(3), np.array([1, 2], np.uint64), times, bias, std, ()))
    assert trail.points[:, 0].tolist() == [0, 0, 1, 2, 3, 0, 0, 0, 0, 0]
    assert trail.points[3, 3] == 0.5


# ---- rates ------------------------------------------------------------------------------------------------------------


def corrected(device: str, rate: float, sequence: int = 0, n: int = 5, boot: int = 1) -> CorrectedBatch:
    ticks, small = (np.arange(sequence, sequence + n) * 10_000).astype(np.uint64), np.full(3, 0.001, np.float32)
    rates = np.tile(np.array([rate, 0, 0], np.float32), (n, 1))
    flags = np.zeros(n, np.uint32)
    at = NOW + sequence * 10_000_000
    return CorrectedBatch(
        device, boot, sequence, at, 1e-6, 1.0, ticks, rates, flags, Quality.GOOD, small, small, small, small, "c", small
    )


def raw(device: str, rate: float, sequence: int = 0, n: int = 5, boot: int = 1) -> SampleBatch:
    of = corrected(device, rate, sequence, n, boot)
    return SampleBatch(
        device, boot, sequence, of.start_time_ns, of.start_time_ns, 1e-6, 1.0, of.ticks, of.rate, None, None, of.flags
    )


def test_raw_and_corrected_are_paired_sample_by_sample() -> None:
    traces = Traces()
    assert traces.take(0.0, [raw("a", 1.0)], []) == []
    (pair,) = traces.take(0.1, [], [corrected("a", 2.0, 0, 2), corrected("a", 3.0, 2, 3)])
    assert pair.raw[:, 0].tolist() == [1] * 5
    assert pair.corrected[:, 0].tolist() == [2, 2, 3, 3, 3]
    assert traces.take(0.2, [raw("a", 1.0, 5)], []) == []
    (alone,) = traces.take(0.3 + ALONE_S, [], [])
    assert np.isnan(alone.corrected).all()


def test_many_samples_keep_their_extremes() -> None:
    traces = Traces()
    of, fine = raw("a", 0.0, 0, 4000), corrected("a", 0.0, 0, 4000)
    of.gyro[1234, 1], fine.rate[2345, 2] = 7.0, -8.0
    points = traces.points(traces.take(0.0, [replace(of, tick_period_s=1e-7)], [fine]))
    assert points is not None
    assert len(points) < 500
    assert points[:, 2].max() == 7.0
    assert points[:, 6].min() == -8.0
    kept = traces.kept()
    assert kept is not None
    assert len(kept) == len(points)


def test_a_heading_drifts_by_the_bias_that_was_not_removed() -> None:
    traces, heading = Traces(), Heading()
    for i in range(200):
        for pair in traces.take(0.0, [raw("a", np.radians(3.0), 5 * i)], [corrected("a", 0.0, 5 * i)]):
            heading.add(pair)
    assert not heading.vertical
    lasted_s = heading.now.time_s - heading.since_s + 0.01
    assert lasted_s > 9.0
    assert np.degrees(heading.now.read) == pytest.approx(3.0 * lasted_s, abs=0.1)
    # Less a bias of 0.001 rad/s about each axis.
    assert np.degrees(heading.now.zeroed) == pytest.approx(2.944 * lasted_s, abs=0.05)
    assert heading.turned == pytest.approx(0.0, abs=1e-9)
    assert heading.now.std == pytest.approx(0.001 * lasted_s, rel=0.01)
    heading.restart(NOW / S + 1)
    heading.restart(NOW / S + 1)
    assert heading.now.read == 0.0


@pytest.mark.parametrize(("up", "read_dps"), [((1.0, 0.0, 0.0), 3.0), ((0.0, 1.0, 0.0), 0.0)])
def test_a_heading_is_about_the_vertical_and_a_tilt_is_none(up: tuple[float, ...], read_dps: float) -> None:
    """A bias about x of 3 °/s, over 100 s: turned more than half round where x is upright, tilted only where y is."""
    traces, heading = Traces(), Heading()
    bias = np.array([np.radians(3.0), 0, 0], np.float32)
    for i in range(2000):
        felt = np.tile(np.array(up, np.float32) * 9.81, (5, 1))
        read, of = replace(raw("a", np.radians(3.0), 5 * i), accel=felt), replace(corrected("a", 0.0, 5 * i), bias=bias)
        for pair in traces.take(0.0, [read], [of]):
            heading.add(pair)
    assert heading.vertical
    lasted_s = heading.now.time_s - heading.since_s + 0.01
    assert np.degrees(heading.now.read) == pytest.approx(read_dps * lasted_s, abs=0.2)
    assert np.degrees(heading.now.zeroed) == pytest.approx(0.0, abs=1e-3)
