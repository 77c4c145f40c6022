"""What waits for a quiet moment: whose turn it is, and that nothing depends on when it is learnt."""

from functools import partial

import numpy as np
import pytest

from bridge.sim.motion import Still
from bridge.wire.messages import CorrectedBatch, Quality
from estimator.device.correct import Cut, batch_of, correct
from estimator.device.samples import Samples
from estimator.service.quiet import AT_ONCE_S, LATE_AFTER_S, LATE_S, Kind, Quiet
from estimator.session import DeviceSession
from tests.estimator.stream import NAME, calibration


class Desk:
    """Work a to e that takes cost_s each, and samples that come at a time."""

    def __init__(self, cost_s: float = 0.0, samples_at: float = float("inf")) -> None:
        self.now, self.done = 0.0, ""
        self._cost_s = cost_s
        self.quiet = Quiet(lambda: self.now >= samples_at, lambda: self.now)
        for name in "abcde":
            self.add(Kind.LEARN, name)

    def add(self, kind: Kind, name: str) -> None:
        self.quiet.add(kind, name, partial(self._work, name))

    def _work(self, name: str) -> None:
        self.now += self._cost_s
        self.done += name


def test_each_is_done_once_and_in_turn_when_nothing_else_is_to_be_done() -> None:
    desk = Desk()
    desk.add(Kind.LEARN, "a")
    desk.quiet.work()
    assert desk.done == "abcde"
    assert not desk.quiet


def test_a_sample_that_comes_is_first() -> None:
    desk = Desk(cost_s=0.001, samples_at=0.0015)
    desk.quiet.work()
    assert desk.done == "ab"
    desk.quiet.work()
    assert desk.done == "ab", "as long as samples wait"
    assert desk.quiet


def test_other_things_are_seen_to_now_and_then() -> None:
    desk = Desk(cost_s=0.75 * AT_ONCE_S)
    desk.quiet.work()
    assert desk.done == "ab"
    desk.quiet.finish()
    assert desk.done == "abcde"


def test_what_takes_long_is_last() -> None:
    desk = Desk()
    desk.add(Kind.CALIBRATE, "x")
    desk.add(Kind.LOOK, "y")
    desk.add(Kind.LEARN, "z")
    desk.quiet.work()
    assert desk.done == "abcdezyx"


def test_who_was_not_looked_after_for_a_second_is_soon_whatever_waits_and_a_few_at_a_time() -> None:
    desk = Desk(cost_s=LATE_S / 2, samples_at=0.0)
    for name in "uvwxyz":
        desk.add(Kind.LOOK, name)
    desk.now += 0.9 * LATE_AFTER_S
    desk.quiet.work()
    assert len(desk.done) == 0, "samples are first"
    desk.now += 0.1 * LATE_AFTER_S
    for name in "uvwxyz":
        desk.add(Kind.LOOK, name)  # it is due again, and as late as it was
    desk.quiet.work()
    assert desk.done == "uvwxyz", "where a round takes long it has a part of that"
    for name in "uvwxyz":
        desk.add(Kind.LOOK, name)
    desk.quiet.work()
    assert desk.done == "uvwxyz"
    desk.now += LATE_AFTER_S
    desk.quiet._worked = desk.now
    desk.quiet.work()
    assert desk.done == "uvwxyzuv", "else so much"
    desk.quiet.work()
    assert desk.done == "uvwxyzuvwx"


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
            if patient:
                device.take(Samples.of(batch), cuts := list[Cut]())
                told[-1] += [batch_of(cut, rates) for cut, rates in zip(cuts, correct(cuts), strict=True)]
            else:
                told[-1] += device.handle(batch).corrected
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
