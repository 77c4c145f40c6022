"""A device goes over to another estimator: as it was calibrated and all, at once, and before nothing that is more urgent."""

from bridge.bus.memory_bus import MemoryBus
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch
from tests.estimator.served import numbers
from tests.estimator.shared.conftest import FIRST, SECOND, WARD, Both, powered_up_again
from tests.estimator.stream import NAME, calibration


def test_it_goes_on_as_it_was_calibrated_and_all(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    worn = len(batches) - 120
    both.start(FIRST)
    both.send(batches[:worn])
    (made,) = both.stores[FIRST].calibrations(NAME)
    assert both.has() == [FIRST]

    both.start(SECOND)
    both.pass_(1.0)
    assert both.has() == [FIRST], "a newcomer holds off first"
    both.pass_(2.0)
    both.send(batches[worn : worn + 60])
    assert both.has() == [SECOND]
    assert [c.id for c in both.stores[SECOND].calibrations(NAME)] == [made.id]
    assert both.command().accepted
    given: list[CorrectedBatch] = both.stream.drain()

    both.kill(SECOND)
    both.send(batches[worn + 60 :])
    both.pass_(0.5)
    assert both.has() == [FIRST]
    assert both.command().accepted
    given += both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    moved = next(at for at, batch in enumerate(given) if batch.quality is Quality.GOOD)
    assert {(batch.quality, batch.calibration) for batch in given[moved:]} == {(Quality.GOOD, made.id)}
    assert len({batch.epoch for batch in given}) == 3
    statuses = both.client.statuses(0.1)
    assert statuses[NAME].epoch == given[-1].epoch
    assert all("conservation law broken" not in service.counts.as_dict() for service in both.services.values())


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
    assert Quality.GOOD not in {batch.quality for batch in said}
    assert [c.id for c in both.stores[FIRST].calibrations(NAME)] == [made.id]


def whole(both: Both, batches: list[SampleBatch]) -> list[CorrectedBatch]:
    """What a subscriber was given: each sample once and in order, under epochs that only rise."""
    given: list[CorrectedBatch] = both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    epochs = [batch.epoch for batch in given]
    assert epochs == sorted(epochs)
    assert all("conservation law broken" not in service.counts.as_dict() for service in both.services.values())
    return given


def worn(both: Both) -> list[SampleBatch]:
    """SECOND has calibrated the device; the last 800 of these batches are still to come."""
    batches = calibration(seed=1, after=[Still(60.0)]).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[:-800])
    assert both.has() == [SECOND]
    return batches


def test_two_that_did_not_hear_each_other_agree_once_they_do(both: Both) -> None:
    batches = worn(both)
    lines = both.part()
    both.send(batches[-800:-200])
    assert sorted(both.has()) == sorted([FIRST, SECOND])
    for line in lines:
        line.cut = False
    both.send(batches[-200:])
    both.pass_(4.0)
    assert both.has() == [SECOND]
    whole(both, batches)


def test_one_that_hung_gives_way_to_who_took_its_device(both: Both) -> None:
    batches = worn(both)
    both.send(batches[-800:-200], still=SECOND)
    both.pass_(0.1, still=SECOND)
    assert FIRST in both.has()
    both.send(batches[-200:])
    both.pass_(4.0)
    assert both.has() == [SECOND]
    whole(both, batches)


def test_without_a_router_all_stays_as_it_is(both: Both) -> None:
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(3.0)
    batches = calibration(seed=1).batches()
    both.send(batches[:40])
    assert both.has() == [SECOND]
    both.broker.stop()
    both.told()
    both.pass_(10.0)
    both.broker.start()
    both.told()
    both.send(batches[40:80])
    both.pass_(4.0)
    assert both.has() == [SECOND]
    assert len({batch.epoch for batch in whole(both, batches[:80])}) == 1
