"""A session that has failed begins anew: what came before it is still known."""

import pytest

from bridge.bus.memory_bus import MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch
from estimator.service.shell import Service
from tests.estimator.served import numbers
from tests.estimator.shared.conftest import FIRST, WARD, Both, fails, powered_up_again
from tests.estimator.stream import NAME


@pytest.fixture
def service(both: Both) -> Service:
    both.start(FIRST)
    return both.services[FIRST]


def fail(service: Service) -> None:
    service._guarded(service._devices[NAME], fails)


def test_what_is_repeated_then_is_not_published_again(both: Both, service: Service, batches: list[SampleBatch]) -> None:
    heard = MemoryBus(both.broker).subscribe(keys.pattern(WARD, "corrected"))
    both.send(batches[:100])
    fail(service)
    both.send([batches[50]])
    both.send(batches[100:140])
    both.pass_(1.0)
    said: list[CorrectedBatch] = [codec.decode_corrected(m.key, m.payload) for m in heard.drain(10_000, 0.0)]
    assert numbers(said) == numbers(batches[:140])  # type: ignore[arg-type]
    sequence = service._devices[NAME].session.sequence
    assert sequence.dropped.as_dict() == {"duplicate": len(batches[50])}
    assert "missing_samples" not in sequence.events.as_dict()


def test_a_power_up_under_the_same_boot_number_is_not_good_then(
    both: Both, service: Service, batches: list[SampleBatch]
) -> None:
    both.send(batches)
    again = powered_up_again(batches[-200:])
    for batch in again[:80]:  # known long ago, again and again
        both.send([batch])
    session = service._devices[NAME].session
    assert session.calibration is None
    assert session.prior is not None
    fail(service)
    both.send(again[80:])
    assert service._devices[NAME].session.applied.quality is Quality.BIAS_ONLY
