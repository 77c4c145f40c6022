"""Lines that are cut: who hears nothing of a device, or of the others, neither keeps it nor takes it."""

from dataclasses import replace

from bridge.sim.motion import Still
from bridge.wire.messages import CorrectedBatch, SampleBatch
from tests.estimator.served import numbers
from tests.estimator.shared.conftest import FIRST, SECOND, Both, Cut
from tests.estimator.stream import calibration


def calibrated(both: Both) -> tuple[list[SampleBatch], int]:
    """SECOND has calibrated the device: all batches, and how many of them were sent."""
    batches = calibration(seed=1, after=[Still(60.0)]).batches()
    worn = len(batches) - 800
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    both.send(batches[:worn])
    assert both.has() == [SECOND]
    return batches, worn


def passes(both: Both, batches: list[SampleBatch]) -> None:
    """They come two at a time, and time goes on with them."""
    for at in range(0, len(batches), 2):
        both.send(batches[at : at + 2])


def cut(both: Both, name: str) -> Cut:
    """The line that an estimator hears devices over, from now on."""
    service = both.services[name]
    line = service._raw = Cut(service._raw)  # type: ignore[assignment]
    return line


def whole(both: Both, batches: list[SampleBatch], before: list[CorrectedBatch] | None = None) -> None:
    """A subscriber was given each sample once and in order, of three turns; before: what it was given already."""
    given: list[CorrectedBatch] = [*(before or ()), *both.stream.drain()]
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches))))
    epochs = [batch.epoch for batch in given]
    assert epochs == sorted(epochs)
    assert len(set(epochs)) == 3
    assert all("conservation law broken" not in service.counts.as_dict() for service in both.services.values())


def test_what_nobody_listened_to_is_said_again_where_it_was_not_said_by_who_had_the_device(both: Both) -> None:
    batches, worn = calibrated(both)
    lines = both.part()
    both.send(batches[worn : worn + 600])
    assert sorted(both.has()) == sorted([FIRST, SECOND]), "neither hears the other"
    cut(both, FIRST)
    both.send(batches[worn + 600 : worn + 700])  # SECOND says them; who has heard FIRST does not listen
    for line in lines:
        line.cut = False
    both.send(batches[worn + 700 :])
    both.pass_(4.0)
    assert both.has() == [SECOND]
    whole(both, batches)


def test_who_has_a_device_and_hears_nothing_of_it_does_not_keep_it(both: Both) -> None:
    """It took it while lines were bad; they carry what it says since, and nothing of what the bridge does."""
    batches, worn = calibrated(both)
    cluster = both.services[SECOND]._peers.cluster
    cluster.knobs = replace(cluster.knobs, retry_s=30.0)  # as after the third time
    lines = both.part()
    both.send(batches[worn : worn + 600])
    assert sorted(both.has()) == sorted([FIRST, SECOND]), "neither hears the other"
    cut(both, FIRST)
    for line in lines:
        line.cut = False
    passes(both, batches[worn + 600 :])
    assert both.has() == [SECOND]
    assert both.services[SECOND]._peers._moves[-1].reason == "shared out anew"
    whole(both, batches)


def test_who_should_have_a_device_and_hears_nothing_of_it_leaves_it_to_the_next(both: Both) -> None:
    batches, worn = calibrated(both)
    both.send(batches[worn : worn + 400])  # the last turn in it
    line = cut(both, SECOND)
    passes(both, batches[worn + 400 : worn + 600])
    assert both.has() == [FIRST]
    given: list[CorrectedBatch] = both.stream.drain()
    assert [n for _, n in numbers(given)] == list(range(sum(map(len, batches[: worn + 600]))))
    line.cut = False
    passes(both, batches[worn + 600 :])
    assert both.has() == [SECOND], "it hears of it again"
    whole(both, batches, given)


def test_what_waited_at_who_should_have_a_device_and_comes_with_a_hole_is_said_by_the_next(both: Both) -> None:
    """A bridge's cache does not answer: what comes waits for what is missing, and is handed on when that is given up."""
    batches, worn = calibrated(both)
    both.send(batches[worn : worn + 200])  # the last turn in it
    line = cut(both, SECOND)
    passes(both, batches[worn + 200 : worn + 700])
    assert both.has() == [FIRST]
    line.cut = False
    assert len(line.drain(100, 0.0)) == 100, "lost to it"
    passes(both, batches[worn + 700 :])
    assert both.has() == [SECOND]
    whole(both, batches)


def test_without_a_router_all_stays_as_it_is(both: Both) -> None:
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(1.2)
    batches = calibration(seed=1).batches()
    both.send(batches[:40])
    both.pass_(1.2)
    assert both.has() == [SECOND]
    epochs = {name: dict(service._peers.cluster.held) for name, service in both.services.items()}
    both.broker.stop()
    both.told()
    both.pass_(10.0)
    both.broker.start()
    both.told()
    both.send(batches[40:80])
    both.pass_(4.0)
    assert {name: service._peers.cluster.held for name, service in both.services.items()} == epochs


def test_who_hears_nothing_at_all_takes_nobody_for_gone(both: Both) -> None:
    batches = calibration(seed=1).batches()
    both.start(FIRST)
    both.start(SECOND)
    both.pass_(9.0)  # neither has just come
    both.send(batches[:40])
    assert both.has() == [SECOND]
    both.pass_(5.0, still=SECOND)
    assert both.has() == [SECOND]
    both.send(batches[40:400], still=SECOND)  # somebody is heard, and it is not SECOND
    assert both.has() == [FIRST, SECOND]
