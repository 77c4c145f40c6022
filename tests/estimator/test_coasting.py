"""More than an estimator can do: first the bias of some is only predicted for a while, in turn, and nothing is lost."""

import logging
from collections import Counter

import numpy as np
import pytest

from estimator.learnt import COASTED
from estimator.lifecycle import Event
from estimator.service.coasting import (
    BACK,
    BUSY,
    CALM_S,
    LEARNS_S,
    MOST,
    OLD_S,
    PATIENCE_S,
    SPARED,
    STEP,
    WAITED_S,
    Coasting,
)
from tests.estimator.served import Served
from tests.estimator.session.lives import off
from tests.estimator.stream import NAME, calibration

NAMES = [f"d{n}" for n in range(100)]


class Loop:
    """A loop that could learn from `does` devices; one that coasts takes it less time. What is too much waits."""

    def __init__(self, does: float, names: list[str] | None = None) -> None:
        self.names = NAMES if names is None else names
        self.does, self.now, self.waits_s, self.shedding = does, 0.0, 0.0, False
        self.coasting = Coasting(lambda: self.names)
        self.coasted, self.stretch, self.longest = Counter[str](), Counter[str](), Counter[str]()
        self.busy, self.worst_s = 0.0, 0.0

    def run(self, seconds: int) -> "Loop":
        for _ in range(seconds):
            self.now += 1.0
            work = (len(self.names) - SPARED * len(self.coasting)) / self.does
            self.busy = 1.0 if self.waits_s else min(work, 1.0)
            self.waits_s = max(0.0, self.waits_s + work - 1.0)
            self.worst_s = max(self.worst_s, self.waits_s)
            self.coasting.look(
                self.now,
                waiting=round(1000 * self.waits_s),
                waited_s=self.waits_s,
                busy=self.busy,
                shedding=self.shedding,
            )
            for name in self.names:
                coasts = name in self.coasting
                self.coasted[name] += coasts
                self.stretch[name] = self.stretch[name] + 1 if not coasts else 0
                self.longest[name] = max(self.longest[name], self.stretch[name])
        return self


@pytest.mark.parametrize("does", [97.0, 90.0, 80.0, 74.0])
def test_as_many_coast_as_it_takes_and_each_in_its_turn(does: float) -> None:
    loop = Loop(does).run(300)
    assert loop.worst_s < OLD_S + PATIENCE_S
    loop.coasted.clear()
    loop.longest.clear()
    loop.run(3600)
    assert loop.worst_s < OLD_S + PATIENCE_S
    assert loop.waits_s < WAITED_S + 3 * PATIENCE_S * (100 / does - 1)
    share = [loop.coasted[name] / 3600 for name in NAMES]
    assert 0 < np.mean(share) <= MOST + 1e-9
    assert max(share) - min(share) < 0.25
    assert min(loop.longest.values()) >= LEARNS_S


@pytest.mark.parametrize("devices", range(1, 12))
@pytest.mark.parametrize("share", [STEP, MOST])
def test_of_a_few_devices_none_coasts_for_ever(devices: int, share: float) -> None:
    loop = Loop(1e9, NAMES[:devices])
    loop.coasting.share, loop.shedding = share, True
    loop.run(1500)
    assert min(loop.longest.values()) >= LEARNS_S
    assert len(loop.coasting) == int(share * devices)
    assert loop.coasting.share == share


def test_nobody_coasts_where_all_can_be_learnt_from() -> None:
    loop = Loop(100.0)
    loop.waits_s = 2 * WAITED_S  # for a moment
    loop.run(1)
    loop.waits_s = 0.0
    assert not loop.run(100).coasted.total()


def test_what_came_all_at_once_and_becomes_less_is_not_too_much() -> None:
    """Over a line that was cut, say: the oldest of it becomes older by a second each second."""
    coasting = Coasting(lambda: NAMES)
    for now, waiting in enumerate(range(60_000, 0, -5000)):
        coasting.look(float(now), waiting=waiting, waited_s=float(now), busy=1.0, shedding=False)
    assert not coasting.share


@pytest.mark.parametrize("does", [105.0, 120.0, 300.0])
def test_all_learn_again_once_there_is_time(caplog: pytest.LogCaptureFixture, does: float) -> None:
    caplog.set_level(logging.INFO)
    loop = Loop(80.0).run(60)
    assert len(loop.coasting)
    loop.does = does
    loop.run(round((MOST / BACK + 1) * CALM_S))
    assert not len(loop.coasting)
    assert "learn from all of it" in caplog.messages[0]
    assert caplog.messages[1:] == ["there is time again to learn from all devices"]


def test_where_it_is_at_ease_all_learn_again_at_once() -> None:
    loop = Loop(80.0).run(60)
    assert loop.coasting.share > 2 * BACK
    loop.does = 200.0
    loop.run(round(2 * CALM_S))
    assert not loop.coasting.share


def test_who_tries_too_early_waits_longer() -> None:
    """A load that is just too much: what waits grows each time that too few coast."""
    loop, tried = Loop(95.0), 0
    for _ in range(3600):
        before = loop.coasting.share
        loop.run(1)
        tried += loop.coasting.share > before
    assert tried <= 10


def test_nobody_learns_again_while_others_are_left_out_or_it_is_busy() -> None:
    loop = Loop(80.0).run(60)
    share, loop.does, loop.shedding = loop.coasting.share, 1000.0, True
    loop.run(100)
    assert loop.coasting.share == share
    loop.shedding = False
    loop.does = (100 - SPARED * len(loop.coasting)) / (BUSY + 0.02)
    loop.run(100)
    assert loop.coasting.share == share


def test_those_that_may_not_learn_and_who_may_no_more_learns_again() -> None:
    loop = Loop(1.0, NAMES[:50]).run(20)
    assert len(loop.coasting) == round(MOST * 50)
    name = next(iter(loop.coasting))
    loop.names = [one for one in loop.names if one != name]
    loop.run(1)
    assert name not in loop.coasting
    alone = Loop(0.5, [])
    alone.run(60)
    assert not alone.coasting.share, "it would help nobody"


def test_a_loop_that_was_stopped_is_not_one_that_is_slow() -> None:
    coasting = Coasting(lambda: NAMES)
    for now in range(0, 100, 10):
        coasting.look(float(now), waiting=now, waited_s=9.0, busy=1.0, shedding=False)
    assert not coasting.share


def test_a_service_tells_its_sessions_and_counts_what_taught_nothing() -> None:
    served, stream = Served(), calibration(seed=1)
    batches = [*stream.batches(), *off(stream, 0.0, 20.0).batches(first=len(stream))]
    coming, said = iter(batches), 0
    with served:
        while not said or served.service._devices[NAME].session.calibration is None:
            served.put(next(coming))
            said += sum(map(len, served.round(0.05)))
        device = served.service._devices[NAME]
        assert served.service._load._able() == [NAME]
        device.session.recalibrate("she", "")
        assert not served.service._load._able(), "somebody is about to turn it"
        device.session.cancel("she")
        served.service._load._coasting.share = 1.0
        for batch in coming:
            served.put(batch)
            said += sum(map(len, served.round(0.05)))
        assert device.session.coasts
        assert device.status(0).events[COASTED] > 1000
        assert said == sum(map(len, batches))


def test_who_is_not_heard_or_left_out_takes_no_turn() -> None:
    served, stream = Served(), calibration(seed=1)
    with served:
        for batch in stream.batches():
            served.put(batch)
            served.round(0.05)
        device, load = served.service._devices[NAME], served.service._load
        assert load._able() == [NAME]
        device.left_out = True
        assert not load._able()
        device.left_out = False
        served.now += 3.0
        assert not load._able(), "not heard for longer than it may be silent"
        device.heard = served.now
        assert load._able() == [NAME]
        device.session.silence("the router is gone", Event.UNREACHABLE)
        assert not load._able()
