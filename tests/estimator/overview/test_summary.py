"""`truerate status`: what is seen at one look, and the exit code."""

from dataclasses import replace

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.wire.messages import DeviceInfo, Quality, State, Status
from estimator.overview.summary import as_json, most, summarise, total
from estimator.service.overload import UNKEPT
from estimator.service.periodic_checks import EVENT
from tests.estimator.stream import info as info_of
from tests.sentences import free

NOTICES = (Code.SAMPLES_BAD(percent="3", label="clipped"), Code.RATE_CHANGED(then_hz="100", now_hz="50"))
STATUS = Status(
    device="a",
    boot=1,
    time_ns=1,
    state=State.TRACKING,
    quality=Quality.GOOD,
    reason=free("calibrated"),
    progress=1.0,
    axes_done=(),
    bias=(0.0, 0.0, 0.0),
    bias_std=(0.0, 0.0, 0.0),
    scale=(1.0, 1.0, 1.0),
    calibration="c",
    calibrated_time_ns=1,
    evidence_age_s=1.0,
    temperature_c=20.0,
    rate_hz=104.0,
    samples_in=100,
    samples_out=90,
    dropped={"duplicate": 10},
)


def statuses(**states: State) -> dict[str, Status]:
    return {
        name: replace(STATUS, device=name, state=state, reason=free(f"why {name}")) for name, state in states.items()
    }


def infos(*names: str, **changes: object) -> dict[str, DeviceInfo]:
    return {name: replace(info_of(), device=name, **changes) for name in names}  # type: ignore[arg-type]


def test_all_is_well() -> None:
    seen = summarise("w", statuses(a=State.TRACKING, b=State.TRACKING), infos("a", "b"), ["bridge"], ["e"])
    assert seen.well
    assert (seen.devices, seen.tracking) == (2, 2)
    assert (seen.samples_in, seen.samples_out, seen.dropped) == (200, 180, 20)
    assert as_json(seen)["law"]["holds"] is True
    over = replace(statuses(c=State.LOST)["c"], reason=(Code.RECORDING_OVER(place="walk.npz"),))
    seen = summarise("w", statuses(a=State.TRACKING) | {"c": over}, infos("a"), ["bridge"], ["e"])
    assert (seen.well, seen.devices, seen.ended, seen.tracking) == (True, 1, 1, 1)


def test_a_store_that_cannot_be_written_is_nobodys_secret() -> None:
    found = {name: replace(status, events={UNKEPT: 1}) for name, status in statuses(a=State.TRACKING).items()}
    seen = summarise("w", found, infos("a"), ["bridge"], ["e"])
    assert not seen.well
    assert seen.troubles[0] == Code.STORE_FAILING(devices=1)


def test_the_most_urgent_comes_first() -> None:
    found = statuses(a=State.TURNING, b=State.DEGRADED, c=State.LOST, d=State.TRACKING, e=State.AWAITING_STILL)
    seen = summarise("w", found, infos(*"abcdef", boot=0, trouble=free("the port is missing")), ["bridge"], ["e"])
    assert [need.device for need in seen.needs] == ["f", "c", "e", "b", "a"]
    assert [need.reason for need in seen.needs] == [free("the port is missing")] * 2 + [
        free("why e"),
        free("why b"),
        free("why a"),
    ]
    assert not seen.well
    assert (seen.devices, seen.tracking) == (6, 1)


def test_a_broken_law_is_trouble() -> None:
    good = statuses(a=State.TRACKING)["a"]
    for wrong, words in (
        (replace(good, samples_out=80), "10 samples are not accounted for"),
        (replace(good, events={EVENT: 2}), "times: 2"),
    ):
        seen = summarise("w", {"a": wrong}, {}, ["b"], ["e"])
        assert words in english(seen.law["a"])
        assert not seen.well
        assert as_json(seen)["law"]["holds"] is False


def test_a_device_that_two_bridges_send_is_trouble_until_one_stops() -> None:
    found = {
        name: replace(s, bridge="b1", refused_bridges=("b2",), events={"also from b2": 50, "gaps": 3})
        for name, s in statuses(a=State.TRACKING, c=State.TRACKING).items()
    }
    seen = summarise("w", found, infos("a", "c"), ["b1", "b2"], ["e"])
    assert seen.troubles == (Code.TWO_BRIDGES(devices="a, c", owner="b1", refused="b2"),)
    assert not seen.well
    assert seen.unused["a"] == {"also sent by b2": 50, "repeated": 10}
    over = {name: replace(s, refused_bridges=()) for name, s in found.items()}
    assert summarise("w", over, infos("a", "c"), ["b1", "b2"], ["e"]).well


def test_what_was_not_used_is_told_with_its_reasons_most_first() -> None:
    found = statuses(a=State.TRACKING, b=State.TRACKING, d=State.TRACKING)
    found["a"] = replace(found["a"], dropped={})
    found["b"] = replace(found["b"], dropped={"range": 1, "old_boot": 40, "non_finite": 2, "duplicate": 7})
    seen = summarise("w", found, infos("a", "b", dropped={"overflow": 5}), ["bridge"], ["e"])
    assert list(seen.unused) == ["b", "d", "a"]
    assert most(seen.unused["b"]) == (
        "40 of an earlier boot, 7 repeated, 5 more than there was room for (at bridge), 3 for other reasons"
    )
    assert total(seen.unused)["repeated"] == 17
    assert as_json(seen)["unused"]["devices"]["d"] == {"repeated": 10}


def test_what_bridges_count_is_told_and_a_notable_share_needs_a_person() -> None:
    events = {"not_a_number": 7, "clipped": 90}
    found = infos("a", events=events, notices=NOTICES)
    seen = summarise("w", statuses(a=State.TRACKING), found, ["bridge"], ["e"])
    assert seen.told == {"a": f"{english(NOTICES[1])} 90 clipped, 7 not a number"}
    assert [need.reason for need in seen.needs] == [NOTICES[:1]]
