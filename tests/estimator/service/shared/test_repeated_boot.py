"""A boot number that came again, where there are several estimators: GOOD only by a calibration of this power-up."""

import pytest

from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import Calibration, CorrectedBatch, Quality, SampleBatch
from estimator.service.device import Device
from tests.estimator.device.test_restore_key import an_hour_later
from tests.estimator.service.shared.conftest import FIRST, SECOND, WARD, Both, fails, powered_up_again
from tests.estimator.stream import NAME, calibration
from tests.memory_bus import MemoryBus


class Handed:
    """FIRST has calibrated the device, whose calibration is in the stores of both; then it went to SECOND."""

    def __init__(self, both: Both) -> None:
        self.both, self.batches = both, calibration(seed=1, after=[Still(30.0)]).batches()
        both.start(FIRST)
        both.send(self.batches[:-60])
        (self.made,) = both.stores[FIRST].calibrations(NAME)
        both.start(SECOND)
        both.pass_(3.0)
        both.send(self.batches[-60:-30])
        assert both.has() == [SECOND]
        self.heard = MemoryBus(both.broker).subscribe(keys.pattern(WARD, "corrected"))

    def device(self, name: str) -> Device:
        return self.both.services[name]._devices[NAME]

    def calibrated(self, name: str) -> Calibration:
        """The one that is in use, which is a new one."""
        made = self.device(name).session.calibration
        assert made is not None
        assert made.id != self.made.id
        return made

    def fail(self, name: str) -> None:
        self.both.services[name]._devices.guard(self.device(name), fails)

    def slowly(self, batches: list[SampleBatch]) -> None:
        """As they are made: what is known long ago, again and again, is another power-up."""
        for batch in batches:
            self.both.send([batch])

    def said(self) -> list[CorrectedBatch]:
        return [codec.decode_corrected(m.key, m.payload) for m in self.heard.drain(10_000, 0.0)]


@pytest.fixture
def handed(both: Both) -> Handed:
    return Handed(both)


@pytest.fixture
def again() -> list[SampleBatch]:
    """An hour later, under the same boot number: a rest of 20 s, turns, and a rest."""
    return an_hour_later(calibration(seed=2, before_s=20.0, after=[Still(20.0)]).batches())


def test_who_is_killed_as_soon_as_it_knows_has_said_so(handed: Handed, both: Both) -> None:
    again, n = powered_up_again(handed.batches[-200:]), 0
    while handed.device(SECOND).repeated is None:
        both.send([again[n]])
        n += 1
    both.kill(SECOND)
    handed.said()
    handed.slowly(again[n:])
    both.pass_(1.0)
    assert handed.device(FIRST).repeated is not None
    assert Quality.GOOD not in {batch.quality for batch in handed.said()}
    # Its own store knows, too.
    assert both.stores[FIRST].calibrated(NAME, handed.made.boot) is None


def test_who_is_restarted_before_it_is_calibrated_anew_still_knows_and_tells(handed: Handed, both: Both) -> None:
    """Another, which was away meanwhile and has the old calibration in its store, is not to go on by that."""
    both.kill(FIRST)
    again, n = powered_up_again(handed.batches[-200:]), 0
    while handed.device(SECOND).repeated is None:
        both.send([again[n]])
        n += 1
    both.kill(SECOND)
    both.start(SECOND, both.stores[SECOND])
    handed.slowly(again[n : n + 20])
    assert handed.device(SECOND).repeated is not None
    both.start(FIRST, both.stores[FIRST])
    handed.slowly(again[n + 20 : n + 30])
    both.pass_(6.0)
    both.kill(SECOND)
    handed.said()
    handed.slowly(again[n + 30 :])
    assert both.has() == [FIRST]
    assert handed.device(FIRST).session.calibration is None
    assert Quality.GOOD not in {batch.quality for batch in handed.said()}
