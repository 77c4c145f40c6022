"""A device goes over to another estimator: as it was calibrated and all, at once, and before nothing that is more urgent."""

from bridge.sim.motion import Still
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch
from tests.estimator.served import numbers
from tests.estimator.service.shared.conftest import FIRST, SECOND, Both
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


def test_a_device_that_sends_is_erased_by_neither(both: Both) -> None:
    batches = calibration(seed=1, after=[Still(30.0)]).batches()
    both.start(FIRST)
    both.send(batches[:-120])
    both.start(SECOND)
    both.pass_(3.0)
    both.send(batches[-120:-60])
    assert both.has() == [SECOND]
    assert not both.command("erase").accepted
    assert all(store.calibrations(NAME) for store in both.stores.values())
    both.kill(SECOND)
    both.send(batches[-60:])
    assert both.client.statuses(0.1)[NAME].calibration, "it went on from what FIRST had kept"


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
