"""Learning waits for a quiet moment: whose turn it is, and that nothing depends on when it is done."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire.messages import CorrectedBatch, Quality
from estimator.service.device import Device
from estimator.service.lessons import AT_ONCE_S, Lessons
from estimator.session import DeviceSession
from tests.estimator.stream import NAME, calibration


class Desk:
    """Devices a to e with a lesson each that takes cost_s, and samples that come at a time."""

    def __init__(self, cost_s: float = 0.0, samples_at: float = float("inf")) -> None:
        self.now, self.learnt = 0.0, list[str]()
        self._cost_s = cost_s
        self.lessons = Lessons(self._learn, lambda: self.now >= samples_at, lambda: self.now)
        self.devices = [
            cast("Device", SimpleNamespace(name=name, session=SimpleNamespace(to_learn=True))) for name in "abcde"
        ]
        for device in self.devices:
            self.lessons.add(device)

    def _learn(self, device: Device) -> None:
        self.now += self._cost_s
        self.learnt.append(device.name)


def test_all_learn_in_turn_when_nothing_else_is_to_be_done() -> None:
    desk = Desk()
    desk.lessons.add(desk.devices[0])
    desk.lessons.work()
    assert desk.learnt == [*"abcde"]
    assert not desk.lessons


def test_a_sample_that_comes_is_first() -> None:
    desk = Desk(cost_s=0.001, samples_at=0.0015)
    desk.lessons.work()
    assert desk.learnt == [*"ab"]
    desk.lessons.work()
    assert desk.learnt == [*"ab"], "as long as samples wait"
    assert desk.lessons


def test_other_things_are_seen_to_now_and_then() -> None:
    desk = Desk(cost_s=0.75 * AT_ONCE_S)
    desk.lessons.work()
    assert desk.learnt == [*"ab"]
    desk.lessons.finish()
    assert desk.learnt == [*"abcde"]


def test_who_had_to_learn_sooner_has_nothing_to_learn() -> None:
    desk = Desk()
    desk.devices[1].session.to_learn = False  # type: ignore[misc] # a simple one
    desk.lessons.work()
    assert desk.learnt == [*"acde"]


@pytest.mark.parametrize("late", [0.02, 0.3, 1.0], ids=["soon", "late", "when it must"])
def test_when_it_is_learnt_changes_nothing(late: float) -> None:
    batches = calibration(seed=3, after=[Still(6.0)]).batches()
    rng = np.random.default_rng(4)
    told: list[list[CorrectedBatch]] = []
    for patient in (False, True):
        device = DeviceSession(NAME)
        device.begin_boot(batches[0].boot, float(batches[0].device_time[0]), None)
        told.append([])
        waits = 0
        for batch in batches:
            told[-1] += (device.take if patient else device.handle)(batch).corrected
            waits += device.to_learn
            if device.to_learn and rng.random() > late:
                device.learn()
        assert (waits > 0) == patient
    assert told[0][-1].quality is Quality.GOOD
    assert [batch.sequence for batch in told[0]] == [batch.sequence for batch in told[1]]
    for one, other in zip(*told, strict=True):
        assert (one.quality, one.calibration) == (other.quality, other.calibration)
        for name in ("rate", "bias", "bias_std", "noise_std", "scale_std"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), strict=True)
