"""A fault in one device's session, wherever it strikes: every sample at stake is counted, and the others go on."""

from dataclasses import replace
from typing import Any

import pytest

from bridge.wire import codec
from bridge.wire.batches import CorrectedEncoder
from estimator.device.admission import Admission
from estimator.device.boot_estimation import BootEstimation
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.device.session import DeviceSession
from estimator.samples.blocks import Blocks
from estimator.service.device import Device
from estimator.service.periodic_checks import EVENT
from estimator.service.store_access import StoreAccess
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import NAME, Stream, info

PLACES: list[tuple[type[Any], str]] = [
    (Admission, "judge"),
    (StoreAccess, "recall"),
    (SequenceNumbers, "fresh"),
    (DeviceSession, "begin_boot"),
    (DeviceSession, "take"),
    (DeviceSession, "learn"),
    (Blocks, "put"),
    (Blocks, "end_block"),
    (BootEstimation, "learn"),
    (CorrectedEncoder, "encode"),
    (Device, "say_corrected"),
    (Device, "say_status"),
]


@pytest.mark.parametrize("rounds", [1, 80], ids=["in one round", "in many"])
@pytest.mark.parametrize("at", [0, 3], ids=["at once", "later"])
@pytest.mark.parametrize(("owner", "name"), PLACES, ids=[f"{o.__name__}.{n}" for o, n in PLACES])
def test_a_fault_anywhere_leaves_no_sample_uncounted(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch, owner: type[Any], name: str, at: int, rounds: int
) -> None:
    batches = once.batches()
    ward.send(batches[:40], info(1))
    whole, calls = getattr(owner, name), [0]

    def failing(*args: Any, **more: Any) -> Any:
        calls[0] += 1
        if calls[0] - 1 in (at, at + 2):
            raise FloatingPointError("singular")
        return whole(*args, **more)

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, failing)
        overtaken = [batches[i + (1, -1, 0, 0)[i % 4]] for i in range(40, 80)] + batches[80:120]
        for begin in range(0, 80, 80 // rounds):
            ward.send(overtaken[begin : begin + 80 // rounds])
        ward.send([b for boot in (2, 3, 4, 5) for b in once.part(0, 30).batches(boot=boot)])
    assert calls[0] > at, "it was put to the test"
    (other,) = once.part(0, 10).batches([])
    ward.put(codec.encode_samples(replace(other, device="other")), bridge="bridge", device="other")
    ward.latest()
    devices = ward.service._devices
    mine = devices[NAME].status(1)
    assert mine.events["session failed"] >= 1
    assert EVENT not in mine.events
    assert mine.samples_in == mine.samples_out + sum(mine.dropped.values())
    assert mine.samples_out == devices[NAME].told
    assert mine.samples_out == sum(len(batch) for batch in ward.subscriber if batch.device == NAME)
    assert mine.samples_in == 800 + 400 + 120
    assert devices["other"].status(1).samples_out == 10
