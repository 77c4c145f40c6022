"""A device goes over to another estimator: as it was calibrated and all, at once, and before nothing that is more urgent."""

import gc
import time
import weakref
from dataclasses import replace

import pytest

from bridge.bus.memory_bus import MemoryBus
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality
from estimator.service.ownership import owner
from tests.estimator.served import numbers
from tests.estimator.shared.conftest import FIRST, SECOND, WARD, Both, Cut
from tests.estimator.shared.test_interim import powered_up_again
from tests.estimator.stream import NAME, calibration


def test_it_goes_on_as_it_was_calibrated_and_all(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    worn = len(batches) - 120
    both.start(FIRST)
    both.send(batches[:worn])
    (made,) = both.stores[FIRST].calibrations(NAME)
    assert both.has() == [FIRST]

    both.start(SECOND)
    both.pass_(0.5)
    assert both.has() == [FIRST], "a newcomer looks round first"
    both.pass_(2.5)
    both.send(batches[worn : worn + 60])
    assert both.has() == [SECOND]
    assert [c.id for c in both.stores[SECOND].calibrations(NAME)] == [made.id]
    assert both.command().accepted

    both.kill(SECOND)
    both.send(batches[worn + 60 :])
    both.pass_(0.5)
    assert both.has() == [FIRST]
    assert both.command().accepted
    given: list[CorrectedBatch] = both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    moved = next(at for at, batch in enumerate(given) if batch.quality is Quality.GOOD)
    assert {(batch.quality, batch.calibration) for batch in given[moved:]} == {(Quality.GOOD, made.id)}
    assert len({batch.epoch for batch in given}) == 3
    statuses = both.client.statuses(0.1)
    assert statuses[NAME].epoch == given[-1].epoch
    assert all("conservation law broken" not in service.counts.as_dict() for service in both.services.values())


def test_who_gives_a_device_back_leaves_it_the_time_to_be_taken_up(both: Both) -> None:
    """Else it is taken again at once by who had it for long, and goes to and fro for as long as a minute."""
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:-200])
    assert both.has() == [SECOND]
    both.kill(SECOND)
    for batch in batches[-200:-90]:  # as they are made: FIRST keeps what came of its own devices, 12 s of it
        both.send([batch])
    assert both.has() == [FIRST]
    both.start(SECOND)
    for batch in batches[-90:]:
        both.services[FIRST]._peers._next_scan = 0.0  # it may look at any time for what it is to take
        both.send([batch])
    assert both.has() == [SECOND]
    given: list[CorrectedBatch] = both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    assert len({batch.epoch for batch in given}) == 3


def test_a_power_up_under_the_same_boot_number_is_not_good_by_what_is_in_the_takers_own_store(both: Both) -> None:
    heard = MemoryBus(both.broker).subscribe(keys.pattern(WARD, "corrected"))
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[:-60])
    (made,) = both.stores[FIRST].calibrations(NAME)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[-60:])
    assert both.has() == [SECOND]

    again = powered_up_again(batches[-200:])
    for batch in again[:80]:  # known long ago, again and again
        both.send([batch])
    both.pass_(6.0)  # it is said to the others
    assert both.services[SECOND]._devices[NAME].session.applied.quality is Quality.BIAS_ONLY
    heard.drain(10_000, 0.0)
    both.kill(SECOND)
    both.send(again[80:])
    both.pass_(1.0)
    both.send(calibration(seed=1).batches()[:1])  # late, of the earlier one
    assert both.has() == [FIRST]
    said: list[CorrectedBatch] = [codec.decode_corrected(m.key, m.payload) for m in heard.drain(10_000, 0.0)]
    assert said[-1].sequence + len(said[-1]) == again[-1].sequence + len(again[-1])
    assert {batch.quality for batch in said} == {Quality.BIAS_ONLY}
    assert [c.id for c in both.stores[FIRST].calibrations(NAME)] == [made.id]


def test_nothing_is_kept_of_a_device_that_has_left(both: Both) -> None:
    """Python is kept from looking for cycles: what was in one would stay for hours."""
    both.start(FIRST)
    batches = calibration(seed=1).batches()
    both.send(batches[:-20])
    device = both.services[FIRST]._devices[NAME]
    kept: list[weakref.ref[object]] = [weakref.ref(of) for of in (device, device.session, device.session.learnt)]
    del device
    gc.collect()
    gc.disable()
    try:
        both.start(SECOND)
        both.pass_(3.0)
        both.send(batches[-20:-5])
        both.pass_(3.0)  # it may still be about to be calibrated
        both.send(batches[-5:])
        both.pass_(60.0)
        assert both.has() == [SECOND]
        assert [what() for what in kept] == [None, None, None]
    finally:
        gc.enable()


def test_rates_of_a_device_that_is_taken_over_come_before_what_is_said_of_it(
    both: Both, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:-20])
    assert both.has() == [SECOND]
    before = both.client.statuses(0.1)[NAME].epoch
    both.stream.drain()
    both.kill(SECOND)
    with monkeypatch.context() as busy:
        busy.setattr(both.services[FIRST]._quiet, "work", lambda: None)
        busy.setattr(both.services[FIRST], "_next_status", both.now + 10.0)
        both.send(batches[-20:])
        both.pass_(0.5)
    epochs = {batch.epoch for batch in both.stream.drain()}
    assert min(epochs) > before
    assert NAME not in both.client.statuses(0.1)
    both.pass_(0.1)
    assert both.client.statuses(0.1)[NAME].epoch == max(epochs)


def test_of_two_the_one_that_is_left_goes_on_at_once(both: Both) -> None:
    """Alone it waited for what came before the first that it had kept: a tenth of a second, of every device."""
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:-2])
    both.stream.drain()
    both.kill(SECOND)
    for batch in batches[-2:]:
        both._raw.put(codec.encode_samples(batch))
        both.services[FIRST].step(0.0)
    assert both.has() == [FIRST]
    assert numbers(both.stream.drain())[-1][1] == sum(map(len, batches)) - 1


def test_who_is_gone_is_noticed_although_no_sample_comes(both: Both) -> None:
    """Who waited for the next sample, of batches of 50 ms, began to take over with that."""
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(calibration(seed=1).batches())
    assert both.has() == [SECOND]
    both.kill(SECOND)
    began = time.monotonic()
    both.services[FIRST].step(60.0)
    assert time.monotonic() - began < 30.0
    assert both.has() == [FIRST]


def test_what_an_estimator_has_does_not_wait_for_what_it_takes_over(both: Both) -> None:
    own = next(name for n in range(100) if owner(name := f"wrist-{n}", (FIRST, SECOND)) == FIRST)
    raw = MemoryBus(both.broker).publisher(keys.build(WARD, "raw", bridge="bridge", device=own), cache=500)
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    for batch in batches[:200]:
        raw.put(codec.encode_samples(replace(batch, device=own)))
    both.send(batches[:200])
    assert both.has() == [SECOND]
    heard = MemoryBus(both.broker).subscribe(keys.pattern(WARD, "corrected"))
    both.kill(SECOND)
    both._raw.put(codec.encode_samples(batches[200]))
    raw.put(codec.encode_samples(replace(batches[200], device=own)))
    both.services[FIRST].step(0.0)
    said = [keys.parse(message.key).device for message in heard.drain(1000, 0.0)]
    assert said[0] == own
    assert said.count(own) == 1
    assert said.count(NAME) > 1


def test_who_starts_takes_nothing_before_it_has_what_bridges_kept(both: Both) -> None:
    """Taken with the first of it, all of fifteen seconds was corrected and said again."""
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    worn = len(batches) - 120
    both.start(FIRST)
    both.send(batches[:worn])
    both.stream.drain()
    both.start(SECOND)
    past = both.services[SECOND]._raw
    both.services[SECOND]._raw = Cut(past)  # type: ignore[assignment]
    both.send(batches[worn : worn + 40])
    both.pass_(3.0)
    assert both.has() == [FIRST]
    both.services[SECOND]._raw = past
    both.pass_(1.0)
    both.send(batches[worn + 40 :])
    assert both.has() == [SECOND]
    assert [n for _, n in numbers(both.stream.drain())] == list(range(10 * worn, sum(map(len, batches))))
    assert both.stream.repeated < 500
