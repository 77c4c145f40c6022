import numpy as np
import pytest

from bridge.framing.deframer import Deframer, frame
from bridge.framing.packets import Data, decode
from bridge.sim.faults import (
    AxisFault,
    BitErrors,
    ByteFault,
    Clipped,
    DroppedBytes,
    DuplicatedChunk,
    Garbage,
    NotANumber,
    Spike,
    StuckAxis,
)
from bridge.sim.virtual_device import SampleFault, demo_device

BYTE_FAULTS = [BitErrors(1e-4), DroppedBytes(1e-3), DuplicatedChunk(0.1), Garbage(0.05)]


def gyro_sent(fault: SampleFault | None) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    device = demo_device("a", 1)
    device.sample_fault = fault
    packets = [decode(payload) for payload in Deframer().feed(device.advance(10.0))]
    return np.concatenate([packet.gyro for packet in packets if isinstance(packet, Data)])


@pytest.mark.parametrize("fault", BYTE_FAULTS, ids=lambda fault: type(fault).__name__)
def test_a_byte_fault_costs_few_frames_and_forges_none(fault: ByteFault) -> None:
    device = demo_device("a", 1)
    clean, dirty = Deframer(), Deframer()
    sent, got = [], []
    for i in range(1, 1001):
        data = device.advance(i * 0.02)
        sent += clean.feed(data)
        got += dirty.feed(fault(data))
    assert fault.injected > 0
    assert set(got) <= set(sent)
    # Each strike ruins at most the frame it is in and, eating a boundary, the next.
    assert len(set(sent) - set(got)) <= 2 * fault.injected
    assert len(set(got)) > 0.5 * len(sent)


@pytest.mark.parametrize("fault", [type(fault)(0.0) for fault in BYTE_FAULTS], ids=lambda fault: type(fault).__name__)
def test_a_byte_fault_of_no_probability_changes_nothing(fault: ByteFault) -> None:
    for data in (b"", b"\0", frame(b"hello"), frame(b"a") + frame(b"b")[:3]):
        assert fault(data) == data
    assert fault.injected == 0


@pytest.mark.parametrize("kind", [NotANumber, Spike, StuckAxis])
@pytest.mark.parametrize(("first", "n"), [(0, 1), (101, 1), (100, 7)])
def test_an_axis_fault_touches_only_its_samples(kind: type[AxisFault], first: int, n: int) -> None:
    fault = kind(first, n, axis=1)
    clean, dirty = gyro_sent(None), gyro_sent(fault)
    struck = np.zeros(clean.shape, bool)
    struck[first : first + n, 1] = True
    np.testing.assert_array_equal(clean[~struck], dirty[~struck])
    assert fault.injected == n
    if kind is NotANumber:
        assert np.isnan(dirty[struck]).all()
    elif kind is Spike:
        np.testing.assert_allclose(dirty[struck] - clean[struck], np.radians(250), rtol=1e-5)
    else:
        assert (dirty[struck] == clean[first, 1]).all()


def test_clipping_limits_and_counts() -> None:
    fault = Clipped(3.0)
    dirty = gyro_sent(fault)
    assert np.abs(dirty).max() == np.float32(np.radians(3.0))
    assert fault.injected == (np.abs(gyro_sent(None)) > np.radians(3.0)).any(axis=1).sum()
