"""`truerate status`: what is seen at one look, and the exit code."""

from dataclasses import replace

import pytest

from bridge.wire.messages import DeviceInfo, Quality, State, Status
from estimator.glance import as_json, glance
from estimator.service.law import EVENT
from tests.estimator.stream import info as info_of

STATUS = Status(
    device="a",
    boot=1,
    time_ns=1,
    state=State.TRACKING,
    quality=Quality.GOOD,
    reason="calibrated",
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
    return {name: replace(STATUS, device=name, state=state, reason=f"why {name}") for name, state in states.items()}


def infos(*names: str, **changes: object) -> dict[str, DeviceInfo]:
    return {name: replace(info_of(), device=name, **changes) for name in names}  # type: ignore[arg-type]


def test_all_is_well() -> None:
    seen = glance("w", statuses(a=State.TRACKING, b=State.TRACKING), infos("a", "b"), ["bridge"], ["e"])
    assert seen.well
    assert (seen.devices, seen.tracking) == (2, 2)
    assert (seen.samples_in, seen.samples_out, seen.dropped) == (200, 180, 20)
    assert as_json(seen)["law"]["holds"] is True


def test_the_most_urgent_comes_first() -> None:
    found = statuses(a=State.TURNING, b=State.DEGRADED, c=State.LOST, d=State.TRACKING, e=State.AWAITING_STILL)
    seen = glance("w", found, infos(*"abcdef", boot=0, trouble="the port is missing"), ["bridge"], ["e"])
    assert [need.device for need in seen.needs] == ["f", "c", "e", "b", "a"]
    assert [need.reason for need in seen.needs] == ["the port is missing"] * 2 + ["why e", "why b", "why a"]
    assert not seen.well
    assert (seen.devices, seen.tracking) == (6, 1)


@pytest.mark.parametrize(("percent", "charging", "needs"), [(9.0, False, 1), (9.0, True, 0), (50.0, False, 0)])
def test_a_battery_that_runs_out(percent: float, charging: bool, needs: int) -> None:
    found = infos("a", battery_percent=percent, charging=charging)
    assert len(glance("w", statuses(a=State.TRACKING), found, ["bridge"], ["e"]).needs) == needs


@pytest.mark.parametrize(
    ("bridges", "estimators", "words"),
    [([], ["e"], "no bridge"), (["b"], [], "no estimator"), (["b"], ["e", "f"], "2 estimators")],
)
def test_parts_that_are_missing_or_too_many(bridges: list[str], estimators: list[str], words: str) -> None:
    (trouble,) = glance("w", statuses(a=State.TRACKING), {}, bridges, estimators).troubles
    assert words in trouble


def test_a_broken_law_is_trouble() -> None:
    good = statuses(a=State.TRACKING)["a"]
    for wrong, words in ((replace(good, samples_out=80), "10 nowhere"), (replace(good, events={EVENT: 2}), "2 times")):
        seen = glance("w", {"a": wrong}, {}, ["b"], ["e"])
        assert words in seen.law["a"]
        assert not seen.well
        assert as_json(seen)["law"]["holds"] is False


def test_an_empty_ward_is_not_well() -> None:
    assert glance("w", {}, {}, ["b"], ["e"]).troubles == ["no device is heard"]
