"""What a device that is taken over has sent since is published before it has a session, once, and as its session would have."""

import threading
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bridge.bus.memory_bus import MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch
from estimator.service.boots import Boots
from estimator.service.device import Device
from estimator.service.intake import Intake
from estimator.service.interim import FAILED, HUNG_NS, RECENT_NS, Taken
from estimator.service.roster import TOO_MANY
from tests.estimator.shared.conftest import LAST, SECOND, WARD, Ward
from tests.estimator.stream import NAME, corrected_by, info


def numbers(said: list[CorrectedBatch]) -> list[int]:
    return [batch.sequence + n for batch in said for n in range(len(batch))]


def fails(*_: object) -> None:
    raise ZeroDivisionError


def powered_up_again(batches: list[SampleBatch]) -> list[SampleBatch]:
    """The same readings under the same boot number, which begin anew a little later."""
    begun, later_ns = batches[0].sequence, 100_000_000_000
    return [
        replace(
            batch,
            sequence=batch.sequence - begun,
            receive_time_ns=batch.receive_time_ns + later_ns,
            start_time_ns=batch.start_time_ns + later_ns,
        )
        for batch in batches
    ]


def test_it_is_published_before_there_is_a_session_and_not_again(ward: Ward, batches: list[SampleBatch]) -> None:
    (made,) = ward.both.stores[SECOND].calibrations(NAME)
    at_once = ward.kill(batches[-LAST:])
    assert numbers(at_once)[-1] == numbers(batches)[-1]  # type: ignore[arg-type]
    assert numbers(at_once) == list(range(at_once[0].sequence, numbers(at_once)[-1] + 1))
    assert {(b.quality, b.calibration) for b in at_once} == {(Quality.GOOD, made.id)}
    assert {b.epoch for b in at_once} == {ward.first._peers.cluster.held[NAME]}
    assert min(b.epoch for b in at_once) > max(b.epoch for b in ward.before)
    assert ward.go_on() == []
    ward.both.send([more := replace(batches[-1], sequence=numbers(at_once)[-1] + 1, ticks=batches[-1].ticks + 100_000)])
    (after,) = ward.said()
    assert (after.sequence, len(after), after.epoch) == (more.sequence, len(more), at_once[0].epoch)
    given = ward.both.stream.drain()
    assert numbers(given) == list(range(more.sequence + len(more)))


def test_what_came_last_is_published_first_and_what_was_before_it_at_once_too(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    """Who is killed has most likely done what was before it; subscribers wait for a moment if not."""
    ward.both.send(batches[-LAST:-4])
    ward.said()
    last = batches[-4:]
    at_once = ward.kill(last)
    sent = [batch for batch in batches if batch.sequence >= min(at.sequence for at in at_once)]
    assert sent[-1].receive_time_ns - sent[0].receive_time_ns < HUNG_NS
    first = [batch.sequence for batch in last if batch.receive_time_ns >= last[-1].receive_time_ns - RECENT_NS]
    assert [batch.sequence for batch in at_once][: len(first)] == first
    assert sorted(numbers(at_once)) == numbers(sent)  # type: ignore[arg-type]
    assert 0 < len(first) < len(last) <= len(sent)
    assert ward.go_on() == []
    assert numbers(ward.both.stream.drain()) == list(range(numbers(sent)[-1] + 1))  # type: ignore[arg-type]


def test_what_was_before_it_is_published_once_of_a_device_that_is_taken_again_meanwhile(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was still to be published of it had its old place, which may be another device's by then."""
    ward.both.send(batches[-LAST:-1])
    ward.said()
    interim, taken = ward.first._interim, list[Taken]()
    say, catch_up = interim.say, interim.catch_up

    def noted(these: list[Taken]) -> None:
        taken.extend(these)
        say(these)

    def taken_again() -> None:
        interim.drop(NAME)
        say(taken)
        catch_up()

    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(interim, "say", noted)
        meanwhile.setattr(interim, "catch_up", taken_again)
        said = numbers(ward.kill(batches[-1:]))
    recent = [number for number, times in Counter(said).items() if times > 1]
    assert sorted(said) == sorted([*range(min(said), max(said) + 1), *recent])
    assert min(said) < min(recent)
    assert max(recent) == max(said)
    ward.go_on()


def test_what_comes_until_there_is_a_session_is_published_as_it_comes(ward: Ward, batches: list[SampleBatch]) -> None:
    """A hundred sessions take some tenths of a second."""
    begun, later = batches[-LAST:-12], [[batch] for batch in batches[-12:-4]]
    at_once = ward.kill(begun, *later, batches[-4:])
    assert numbers(at_once) == list(range(at_once[0].sequence, numbers(batches)[-1] + 1))  # type: ignore[arg-type]
    assert {b.epoch for b in at_once} == {ward.first._peers.cluster.held[NAME]}
    assert {b.quality for b in at_once} == {Quality.GOOD}
    assert ward.go_on() == []
    assert not ward.first._interim._said
    assert numbers(ward.both.stream.drain()) == list(range(numbers(batches)[-1] + 1))  # type: ignore[arg-type]


@pytest.mark.parametrize("odd", ["missing", "another boot", "again"])
def test_from_what_is_out_of_the_ordinary_then_on_all_waits_for_its_session(
    ward: Ward, batches: list[SampleBatch], odd: str
) -> None:
    begun, (first, then, *after) = batches[-LAST:-8], batches[-8:]
    if odd == "another boot":
        then, *after = (replace(batch, boot=then.boot + 1) for batch in (then, *after))
    later = [[first], after] if odd == "missing" else [[first], [first if odd == "again" else then], after]
    at_once = ward.kill(begun, *later)
    assert numbers(at_once)[-1] == numbers([first])[-1]  # type: ignore[list-item]
    said = [(batch.boot, n) for batch in ward.go_on() for n in numbers([batch])]
    expected = after if odd in {"missing", "again"} else [then, *after]
    assert said == [(batch.boot, n) for batch in expected for n in numbers([batch])]  # type: ignore[list-item]
    assert not ward.first._interim._said


def test_it_is_corrected_as_who_had_it_did(ward: Ward, batches: list[SampleBatch]) -> None:
    at_once, of = ward.kill(batches[-LAST:])[-1], corrected_by(ward.theirs.applied, batches[-1])
    for what in ("rate", "bias"):
        assert (np.abs(getattr(at_once, what) - getattr(of, what)) < at_once.bias_std).all()
    # What was said of it last is some seconds old.
    assert (at_once.bias_std > of.bias_std).all()
    assert (at_once.bias_std < 5 * of.bias_std).all()
    for what in ("scale_std", "cross_std", "ticks", "start_time_ns"):
        np.testing.assert_array_equal(getattr(at_once, what), getattr(of, what))
    ward.go_on()


@pytest.mark.parametrize("odd", ["missing", "another boot"])
def test_what_is_out_of_the_ordinary_waits_for_its_session(ward: Ward, batches: list[SampleBatch], odd: str) -> None:
    last, at = batches[-LAST:], 12
    one = last[at]
    if odd == "missing":
        del last[at]
    else:
        last[at:] = [replace(batch, boot=batch.boot + 1) for batch in last[at:]]
    at_once = ward.kill(last)
    assert numbers(at_once)[-1] == one.sequence - 1
    later = ward.go_on()
    assert later
    said = [(b.boot, n) for b in at_once + later for n in numbers([b])]
    assert said == sorted(set(said), key=said.index)
    sent = {(b.boot, n) for b in last for n in numbers([b])}  # type: ignore[list-item]
    assert sent <= set(said)


def test_nothing_is_said_by_a_calibration_of_which_only_a_session_knows_whether_it_holds(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    replicas = ward.first._peers.replicas
    known = replicas.of(NAME)
    assert known is not None
    assert known.calibration is not None
    earlier = replace(known, calibration=replace(known.calibration, boot=known.boot - 1))
    replicas.note(replace(earlier, epoch=known.epoch))
    assert ward.kill(batches[-LAST:]) == []
    assert numbers(ward.go_on())[-1] == numbers(batches)[-1]  # type: ignore[arg-type]


def test_of_what_it_is_not_known_what_it_is_nothing_is_said(ward: Ward, batches: list[SampleBatch]) -> None:
    ward.first._peers.replicas._latest.clear()
    assert ward.kill(batches[-LAST:]) == []
    assert numbers(ward.go_on())[-1] == numbers(batches)[-1]  # type: ignore[arg-type]


def test_one_that_fails_waits_for_its_session_and_is_counted(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("estimator.service.interim.correction", fails)
    assert ward.kill(batches[-LAST:]) == []
    assert ward.first.counts.as_dict()[FAILED] == 1
    assert numbers(ward.go_on())[-1] == numbers(batches)[-1]  # type: ignore[arg-type]


def test_what_was_said_of_one_that_is_anothers_before_it_has_a_session_may_still_be_asked_for(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    ward.kill(batches[-LAST:])
    said = ward.first._interim._said[NAME]
    ward.first._give_away([NAME], ward.both.now)
    assert ward.first._interim._said == {}
    assert [publisher for _, publisher in ward.first._left] == [said.publisher]
    ward.go_on()


def test_one_that_cannot_be_published_does_not_end_the_service(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("estimator.service.interim.Encoder", lambda *_: SimpleNamespace(encode=fails))
    assert ward.kill(batches[-LAST:]) == []
    assert ward.first.counts.as_dict()[FAILED] == 1
    assert numbers(ward.go_on())[-1] == numbers(batches)[-1]  # type: ignore[arg-type]


def test_a_leap_of_its_clock_waits_for_its_session(ward: Ward, batches: list[SampleBatch]) -> None:
    last, at = batches[-LAST:], 12
    last[at:] = [replace(batch, ticks=batch.ticks + np.uint64(10**12)) for batch in last[at:]]
    at_once = ward.kill(last)
    assert numbers(at_once)[-1] == last[at].sequence - 1
    assert {batch.quality for batch in at_once} == {Quality.GOOD}
    ward.go_on()


@pytest.mark.parametrize(
    ("of", "name", "after"),
    [(Intake, "_handle_one", 0), (Intake, "_handle_one", 8), (Device, "say_corrected", 8)],
)
def test_what_a_session_that_fails_had_not_taken_in_yet_is_not_lost_where_it_was_published(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch, of: type, name: str, after: int
) -> None:
    last = batches[-LAST:]
    at_once = ward.kill(last)
    work, failures = getattr(of, name), iter([False] * after + [True])

    def works(*args: object, **more: object) -> object:
        if next(failures, False):
            raise ZeroDivisionError
        return work(*args, **more)

    monkeypatch.setattr(of, name, works)
    assert ward.go_on() == []
    assert list(failures) == []
    assert numbers(at_once)[-1] == numbers(batches)[-1]  # type: ignore[arg-type]
    sequence = ward.first._devices[NAME].session.sequence
    assert "session failed" not in sequence.dropped.as_dict()
    assert sequence.events.as_dict()["session failed"] == 1


def test_a_boot_that_begins_anew_under_its_number_is_published(ward: Ward, batches: list[SampleBatch]) -> None:
    at_once = ward.kill(batches[-LAST:])
    ward.go_on()
    anew = [
        replace(batch, receive_time_ns=batch.receive_time_ns + 10**11, start_time_ns=batch.start_time_ns + 10**11)
        for batch in batches[-3 * LAST :]
    ]
    for batch in anew:  # what comes again is taken for a repetition until it persists
        ward.both.send([batch])
    said = numbers(ward.said())
    assert said == list(range(said[0], numbers(anew)[-1] + 1))  # type: ignore[arg-type]
    assert set(said) & set(numbers(at_once))


def test_numbers_before_those_published_at_once_are_published_where_they_begin_a_session(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    last = batches[-LAST:]
    first, then = last[LAST // 2 - 1], last[LAST // 2 :]
    ward.both.pass_(1.0)
    at_once = ward.kill(then)
    assert sorted(numbers(at_once)) == numbers(then)  # type: ignore[arg-type]
    with monkeypatch.context() as failing:
        failing.setattr(Intake, "_handle_one", fails)
        assert ward.go_on() == []
    ward.both.send([first])  # where the boot begins is not known now: it is waited for
    assert numbers(ward.go_on()) == numbers([first])  # type: ignore[list-item]


def test_nothing_is_said_by_a_calibration_that_another_range_in_this_boot_has_made_void(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    assert ward.kill(batches[-LAST:], what=replace(info(), gyro_range=4.4)) == []
    later = ward.go_on()
    assert numbers(later)[-1] == numbers(batches)[-1]  # type: ignore[arg-type]
    assert Quality.GOOD not in {batch.quality for batch in later}


def test_it_stops_when_all_that_was_published_at_once_is_handled(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    at_once = ward.kill(batches[-LAST:])
    turn, busy = ward.first._peers.turn, iter([True] * 3)
    monkeypatch.setattr(ward.first._peers, "turn", lambda: [] if next(busy, False) else turn())
    stop = threading.Event()
    stop.set()
    ward.first.run(stop)
    assert ward.said() == []
    sequence = ward.first._devices[NAME].session.sequence
    assert sequence.next == at_once[-1].sequence + len(at_once[-1])


def test_what_fails_again_and_again_after_it_counts_as_dropped(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    last, more = batches[-LAST:-5], batches[-5:]
    ward.kill(last)
    monkeypatch.setattr(Boots, "begin", fails)
    ward.go_on()
    ward.both.send(more)
    ward.both.pass_(1.0)
    assert ward.said() == []
    dropped = ward.first._devices[NAME].session.sequence.dropped.as_dict()
    assert dropped == {"session failed": len(numbers(more))}  # type: ignore[arg-type]


def test_what_was_published_at_once_is_not_dropped_where_another_boot_begins_after_a_fault(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    last = batches[-LAST:]
    last[12:] = [replace(batch, boot=batch.boot + 1) for batch in last[12:]]
    at_once = ward.kill(last)
    work, failures = Boots.begin, iter([True])

    def begin(*args: Any, **more: Any) -> Any:
        if next(failures, False):
            raise ZeroDivisionError
        return work(*args, **more)

    monkeypatch.setattr(Boots, "begin", begin)
    said = at_once + ward.go_on()
    boots = [{(b.boot, n) for b in some for n in numbers([b])} for some in (said, last)]  # type: ignore[list-item]
    assert boots[0] >= boots[1]
    assert ward.first._devices[NAME].session.sequence.dropped.as_dict() == {}


def test_of_a_device_with_no_room_nothing_is_published(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as full:
        full.setattr("estimator.service.roster.MAX_DEVICES", 0)
        assert ward.kill(batches[-LAST:]) == []
        ward.both.pass_(1.0)
        assert ward.first.counts.as_dict()[TOO_MANY] >= len(numbers(batches[-LAST:]))  # type: ignore[arg-type]
    ward.both.pass_(1.0)
    ward.both.send(batches[-1:])


def test_its_publisher_is_taken_back_where_there_is_no_room_any_more(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ward.kill(batches[-LAST:])
    with monkeypatch.context() as full:
        full.setattr("estimator.service.roster.MAX_DEVICES", 0)
        ward.both.pass_(1.0)
    assert ward.first._interim._said == {}
    ward.both.pass_(1.0)
    ward.both.send(batches[-1:])


def test_a_power_up_under_the_same_boot_number_has_no_calibration_with_whoever_takes_it_over(
    ward: Ward, batches: list[SampleBatch]
) -> None:
    again = powered_up_again(batches[-200:])
    for batch in again[:80]:  # known long ago, again and again
        ward.both.send([batch])
    assert ward.said()[-1].quality is Quality.BIAS_ONLY
    ward.both.pass_(6.0)  # it is said to the others
    said = ward.kill(again[80:100]) + ward.go_on()
    ward.both.send(again[100:])
    said += ward.said()
    assert numbers(said)[-1] == numbers(again)[-1]  # type: ignore[arg-type]
    assert Quality.GOOD not in {batch.quality for batch in said}


def test_nobody_keeps_those_taken_over_waiting_by_making_up_names(
    ward: Ward, batches: list[SampleBatch], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("estimator.service.roster.MAX_DEVICES", 100)
    monkeypatch.setattr("estimator.service.peers.TAKEN_AT_ONCE", 16)
    monkeypatch.setattr("estimator.service.peers.TAKEN_MOST", 64)
    ward.both.kill(SECOND)
    stranger = MemoryBus(ward.both.broker)
    for number, batch in enumerate(batches[-LAST:]):
        for n in range(20):
            name = f"made-up-{20 * number + n}"
            publisher = stranger.publisher(keys.build(WARD, "raw", bridge="x", device=name))
            publisher.put(codec.encode_samples(replace(batch, device=name)))
            publisher.close()
        ward.both.send([batch])
    assert NAME in ward.first._devices
    assert ward.first._peers.waiting <= 64
