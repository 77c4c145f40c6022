"""The pure parts: what is made of messages, with time as an argument."""

from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.wire import keys
from bridge.wire.codec import Rates
from bridge.wire.messages import NO_REST_S, BiasRevision, BootCause, CorrectedBatch, Quality, SampleBatch, State
from estimator.guide.guide import Guide
from estimator.history import Biases, History
from estimator.texts import texts
from estimator.ward_view import URGENCY
from estimator.web import words
from estimator.web.device_page import device_page
from estimator.web.guide_view import guide_view
from estimator.web.heading import Heading
from estimator.web.known import DEVICES, LOOKED_S, Known
from estimator.web.reports import past
from estimator.web.strips import Strips
from estimator.web.tiles import TONES, ward_page
from estimator.web.traces import ALONE_S, Points, Traces
from estimator.web.trail import POINTS, Trail
from tests.estimator.test_correction import CALIBRATION
from tests.sentences import free
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


def test_every_state_has_a_tone() -> None:
    assert set(TONES) == set(URGENCY)


def test_a_low_battery_needs_a_person_and_says_so() -> None:
    page = ward_page(known(about("a", battery_percent=9.0), said("a"), said("b")), 100.0, NOW, EN)
    assert [(tile.id, tile.tone, tile.needs) for tile in page.tiles] == [("a", "ask", True), ("b", "well", False)]
    assert page.tiles[0].notices == "The battery is at 9 %: charge it."
    assert (page.tracking, page.of, page.counts[-1]) == (2, 2, ("tracking", "well", 2, "tracking"))
    assert [n for _, _, n, _ in page.counts[:-1]] == [0] * (len(URGENCY) - 1)


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


def test_a_reboot_is_said_until_it_is_calibrated_again() -> None:
    ward = known(about("a", boot=1, time_ns=NOW - 900 * S), said("a", boot=1, calibrated_time_ns=NOW))
    ward.take_info(about("a", boot=2, time_ns=NOW - 5 * S, boot_cause=BootCause.PORT_OPENED))
    ward.take_status(said("a", State.AWAITING_STILL, boot=2), 100.0)
    (tile,) = ward_page(ward, 100.0, NOW, EN).tiles
    assert tile.rebooted == "started again 5 s ago, its port was opened: it must be calibrated again"
    ward.take_status(said("a", State.DEGRADED, boot=2, calibrated_time_ns=NOW), 100.0)
    assert ward_page(ward, 100.0, NOW, EN).tiles[0].rebooted == ""


def test_a_device_nobody_speaks_of_any_more_is_silent() -> None:
    (tile,) = ward_page(known(said("a")), 110.0, NOW, EN).tiles
    assert (tile.state, tile.tone) == ("silent", "bad")
    assert "10 s" in tile.reason
    assert ward_page(known(said("a")), 100.0, NOW, EN).tiles[0].stale == ""
    for ahead_s in (-3600, 3600):  # by the estimator's clock; when it was heard is a matter of our own
        ward = known(said("a", time_ns=NOW + ahead_s * S), said("a", time_ns=NOW + ahead_s * S + 1))
        assert ward_page(ward, 110.0, NOW, EN).tiles[0].stale == "as of 10 s ago"


def test_without_a_router_a_device_is_unknown_and_never_gone() -> None:
    ward = known(said("a"), said("b", State.LOST), about("c"))
    ward.connected = False
    page = ward_page(ward, 500.0, NOW, EN)
    assert {tile.id: (tile.state, tile.reason) for tile in page.tiles} == {
        "a": ("unknown", f"{GONE} When it was heard last, its state was: tracking."),
        "b": ("unknown", f"{GONE} When it was heard last, its state was: lost."),
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


def test_the_guide_shows_no_tick_of_a_device_that_is_less_exact() -> None:
    ward, tones = known(said("a", State.DEGRADED, reason=free("the bias jumped")), said("b")), {}
    for name in ("a", "b"):
        guide = Guide()
        guide.take_status(ward.stories[name].status or said(name))
        view = guide_view(guide.told(), ward, name, 100.0)
        tones[name] = view.tone, view.say["en"].wrong
    assert tones == {"a": ("ask", ["the bias jumped"]), "b": ("well", [])}


def test_of_turns_that_are_over_it_is_not_said_by_which_edge() -> None:
    ward, guide = known(said("a")), Guide()
    guide.take_status(ward.stories["a"].status or said("a"))
    turns = guide_view(guide.told(), ward, "a", 100.0).say["en"].turns
    assert [(turn.axis, turn.how, turn.state) for turn in turns] == [(axis, "", "done") for axis in "xyz"]


def test_without_a_router_a_page_says_its_own_word_for_how_a_device_was() -> None:
    ward = known(said("a", State.BIAS_ONLY))
    ward.connected = False
    (tile,) = ward_page(ward, 500.0, NOW, EN).tiles
    assert "its state was: to be turned" in tile.reason
    (tile,) = ward_page(ward, 500.0, NOW, texts("zh")).tiles
    assert tile.reason.endswith("最后收到时的状态：仅有零偏。")


def test_a_picture_begins_where_the_store_does() -> None:
    ward = known(said("a", boot=1, time_ns=NOW), said("a", boot=1, time_ns=NOW + S))
    at = NOW - np.arange(50, 0, -1) * 60 * S
    stored = Biases(keys.boot_id(1), at, np.zeros((50, 3)), np.full((50, 3), 1e-4), np.full(50, 30.0))
    ward.take_past(History("a", (), (), (), (stored, replace(stored, boot="other"))))
    (drawn,) = past(ward.stories["a"], "a").biases
    assert len(drawn.time_ns) == 52
    assert np.all(np.diff(drawn.time_ns) > 0)
    assert drawn.time_ns[0] == at[0]


def test_a_rest_is_said_only_where_there_was_one() -> None:
    ward = known(said("a"), said("b", evidence_age_s=5.0), about("c"))
    rests = {tile.id: tile.rest for tile in ward_page(ward, 100.0, NOW, EN).tiles}
    assert rests == {"a": "none known yet", "b": "5 s ago", "c": ""}


def test_one_gap_is_one_gap() -> None:
    for count, missing, lost, happened in (
        (0, 0, "none", "movement ignored: 2"),
        (1, 98, "98, in one gap", "gaps: 1, missing samples: 98, movement ignored: 2"),
        (3, 99, "99, in 3 gaps", "gaps: 3, missing samples: 99, movement ignored: 2"),
    ):
        events = {"movement ignored": 2, "missing_samples": missing, "gaps": count}
        page = device_page(known(said("a", events=events)), "a", 100.0, NOW, EN)
        assert page.tile.gaps == lost
        assert dict(page.facts)["happened"] == happened


def test_too_many_devices_are_said() -> None:
    ward = known(*(about(f"d{i}") for i in range(DEVICES + 3)))
    assert len(ward.stories) == DEVICES
    assert any("too many devices: 3" in words for words in ward_page(ward, 100.0, NOW, EN).troubles)


def test_a_device_page_tells_of_calibrations_with_their_intervals() -> None:
    ward = known(about("a", boot=5), said("a", boot=5, calibration=CALIBRATION.id))
    ward.take_calibration(replace(CALIBRATION, device="a"))
    ward.take_calibration(replace(CALIBRATION, device="a"))
    (line,) = device_page(ward, "a", 100.0, NOW, EN).calibrations
    assert line.in_use
    k_std = float(np.sqrt(CALIBRATION.covariance[3, 3]))
    assert line.scale[0] == f"{CALIBRATION.matrix[0, 0]:.4f} ±{words.SPACE}{1.96 * k_std:.4f}"


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
    assert POINTS / 2 < len(trail) <= POINTS
    assert trail.points[0, 0] == 0.0
    assert trail.points[-1, 0] == 5 * POINTS - 1
    assert np.all(np.diff(trail.times_ns) > 0)
    trail.take(said("a", boot=1, time_ns=NOW))
    assert trail.points[-1, 0] == 5 * POINTS - 1


def test_a_clock_that_was_set_back_takes_from_a_trail_what_it_has_not_come_to_yet() -> None:
    trail = Trail()
    for i in range(100):
        trail.take(said("a", boot=1, time_ns=NOW + i * S, evidence_age_s=0.2))
    trail.take(said("a", boot=1, time_ns=NOW + 10 * S))
    assert len(trail) == 100, "one alone is late"
    for i in range(100, 103):
        trail.take(said("a", boot=1, time_ns=NOW + i * S))
    for i in range(40, 50):
        trail.take(said("a", boot=1, time_ns=NOW + i * S, bias=(1.0, 0.0, 0.0)))
    assert trail.times_ns.tolist() == [NOW + i * S for i in range(50)]
    assert trail.points[:, 0].tolist() == [0.0] * 41 + [1.0] * 9
    assert all(end <= NOW + 50 * S for _, end in trail.rests)


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


def test_a_spread_has_holes_where_nothing_was_said() -> None:
    trail = Trail()
    for i in [*range(10), *range(60, 70)]:
        trail.take(said("a", boot=1, time_ns=NOW + i * S, bias=(float(i), 0.0, 0.0)))
    found = trail.spread(70, NOW, NOW + 69 * S)[:, 0]
    assert found[5] == 5
    assert found[65] == 65
    assert np.isnan(found[30])
    assert np.isnan(Trail().spread(5, NOW, NOW + S)).all()


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


def test_strips_have_the_least_and_the_most_of_each_device() -> None:
    said_of = (("a", 1.0), ("b", 2.0), ("a", 3.0), ("stranger", 9.0))
    batches = [Rates(name, corrected(name, rate).rate) for name, rate in said_of]
    found = Strips().take(batches, {"b": 0, "quiet": 1, "a": 2})
    np.testing.assert_allclose(found[[0, 2]], np.degrees([[2, 2], [1, 3]]), rtol=1e-6)
    assert np.isnan(found[1]).all()
    assert Strips().take([], {}).shape == (0, 2)


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
    assert points.raw[:, 1].max() == 7.0
    assert points.corrected[:, 2].min() == -8.0
    kept = traces.kept()
    assert kept is not None
    assert len(kept) == len(points)


def test_a_clock_that_was_set_back_begins_the_pictures_anew() -> None:
    traces, heading = Traces(), Heading()

    def go_on(first: int, last: int, back_s: int = 0) -> list[Points | None]:
        found = []
        for i in range(first, last):
            read = raw("a", 0.1, 5 * i)
            read = replace(read, start_time_ns=read.start_time_ns - back_s * S)
            pairs = traces.take(0.0, [read], [corrected("a", 0.1, 5 * i)])
            for pair in pairs:
                heading.add(pair)
            found.append(traces.points(pairs))
        return found

    go_on(0, 200)
    assert go_on(190, 191) == [None], "it came late"
    assert len(heading.points) == 10
    go_on(200, 300, 3600)
    for times in ([point.time_s for point in heading.points], traces.kept().time_s):  # type: ignore[union-attr]
        assert len(times) > 4
        assert np.all(np.diff(times) > 0)
        assert times[-1] < NOW / S - 3500


def test_a_clock_that_is_set_back_within_what_comes_at_once_harms_nothing() -> None:
    traces = Traces()
    both = [raw("a", 0.1, 0), replace(raw("a", 0.1, 5), start_time_ns=NOW - 3600 * S)]
    points = traces.points(traces.take(0.0, both, [corrected("a", 0.1, 0, 10)]))
    assert points is not None
    assert len(points) > 0


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


@pytest.mark.parametrize(("rest_s", "since_s"), [(5.02, 5.02), (-66.0, 0.0), (3600.0, 0.0)])
def test_a_heading_begins_with_the_rest_also_of_samples_that_came_at_once(rest_s: float, since_s: float) -> None:
    """A rest within them, one before all of them, and one by a clock that is an hour ahead."""
    traces, heading = Traces(), Heading()
    heading.restart(NOW / S + rest_s)
    for i in range(200):
        for pair in traces.take(0.0, [raw("a", np.radians(3.0), 5 * i)], [corrected("a", 0.0, 5 * i)]):
            heading.add(pair)
    first_s = traces.take(0.0, [raw("a", 0.0)], [corrected("a", 0.0)])[0].time_s[0]
    assert heading.since_s - first_s == pytest.approx(since_s, abs=0.06)
    lasted_s = heading.now.time_s - heading.since_s + 0.01
    assert np.degrees(heading.now.read) == pytest.approx(3.0 * lasted_s, abs=0.1)
    assert heading.points[0].time_s >= heading.since_s


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
