"""More than an estimator can do: first the bias of some is only predicted for a while, in turn, and nothing is lost."""

import logging
from collections import Counter

import numpy as np
import pytest

from estimator.learnt import COASTED
from estimator.service import overload
from estimator.service.coasting import BUSY, CALM_S, LEARNS_S, MOST, OLD_S, PATIENCE_S, SOON_S, STEP, WAITED_S, Coasting
from tests.estimator.served import Served
from tests.estimator.session.lives import off
from tests.estimator.stream import NAME, calibration

NAMES = [f"d{n}" for n in range(100)]


class Loop:
    """A loop that learns from `learns` of so many devices at most, and is behind by more each second otherwise."""

    def __init__(self, learns: float, names: list[str] | None = None) -> None:
        self.names = NAMES if names is None else names
        self.learns, self.now, self.waited_s, self.shedding = learns, 0.0, 0.0, False
        self.coasting = Coasting(lambda: self.names)
        self.coasted, self.stretch, self.longest = Counter[str](), Counter[str](), Counter[str]()

    def run(self, seconds: int) -> "Loop":
        for _ in range(seconds):
            self.now += 1.0
            done = (len(self.names) - len(self.coasting)) / self.learns
            self.waited_s = max(0.0, self.waited_s + 0.3 * (done - 1.0))
            busy = 1.0 if self.waited_s else 0.5 + 0.5 * done
            self.coasting.look(self.now, waited_s=self.waited_s, busy=busy, shedding=self.shedding)
            for name in self.names:
                coasts = name in self.coasting
                self.coasted[name] += coasts
                self.stretch[name] = self.stretch[name] + 1 if not coasts else 0
                self.longest[name] = max(self.longest[name], self.stretch[name])
        return self


@pytest.mark.parametrize("learns", [90.0, 60.0, 30.0, 12.0])
def test_as_many_coast_as_it_takes_and_each_in_its_turn(learns: float) -> None:
    loop = Loop(learns).run(60)
    assert loop.waited_s < 3 * (OLD_S + PATIENCE_S) / 2 + 1.0
    loop.coasted.clear()
    loop.longest.clear()
    loop.run(600)
    assert loop.waited_s < 1.0
    share = [loop.coasted[name] / 600 for name in NAMES]
    assert 0 < np.mean(share) <= MOST + 1e-9
    assert max(share) - min(share) < 0.2
    assert min(loop.longest.values()) >= LEARNS_S


def test_nobody_coasts_where_all_can_be_learnt_from() -> None:
    loop = Loop(100.0)
    loop.waited_s = 2 * WAITED_S  # for a moment
    loop.run(1)
    loop.waited_s = 0.0
    assert not loop.run(100).coasted.total()


def test_all_learn_again_once_there_is_time(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    loop = Loop(60.0).run(60)
    assert len(loop.coasting)
    loop.learns = 200.0
    loop.run(round(MOST / STEP + 10 * CALM_S))
    assert not len(loop.coasting)
    assert "learn from all of it" in caplog.messages[0]
    assert caplog.messages[1:] == ["there is time again to learn from all devices"]


def test_who_tries_too_early_waits_longer() -> None:
    """A load that is just too much: what waits grows each time that too few coast."""
    loop, tried = Loop(95.0), 0
    for _ in range(1200):
        before = loop.coasting.share
        loop.run(1)
        tried += loop.coasting.share > before
    assert tried <= 8


def test_nobody_learns_again_while_others_are_left_out_or_it_is_busy() -> None:
    loop = Loop(50.0).run(60)
    share, loop.learns, loop.shedding = loop.coasting.share, 1000.0, True
    loop.run(100)
    assert loop.coasting.share == share
    loop.shedding = False
    loop.learns = (100 - len(loop.coasting)) / (2 * BUSY - 1.0 + 0.1)
    loop.run(100)
    assert loop.coasting.share == share


def test_those_that_may_not_learn_and_who_may_no_more_learns_again() -> None:
    loop = Loop(1.0, NAMES[:50]).run(60)
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
        coasting.look(float(now), waited_s=9.0, busy=1.0, shedding=False)
    assert not coasting.share
    assert SOON_S > CALM_S


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


def test_it_is_said_that_not_all_is_learnt() -> None:
    served, batches = Served(), calibration(seed=1).batches()
    with served:
        served.put(batches[0])
        served.round()
        device = served.service._devices[NAME]
        device.session.sequence.events.add(COASTED, 100)
        device.overloaded_s = 7
        [words] = overload.found([device.status(0)])
        assert "does not learn from all that comes" in words
        device.overloaded_s = 0
        assert not overload.found([device.status(0)])
