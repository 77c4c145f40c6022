import numpy as np
import pytest

from bridge.framing.deframer import Deframer, frame
from bridge.framing.packets import Data, decode
from bridge.sim.faults import (
    AxisFault,
    BitErrors,
    ByteFault,
    Clipped,
    Dribble,
    DroppedBytes,
    DuplicatedChunk,
    Garbage,
    HeldUp,
    NotANumber,
    Spike,
    Stuck,
    StuckAxis,
    TemperatureLeap,
)
from bridge.sim.virtual_device import SampleFault, demo_device

BYTE_FAULTS = [BitErrors(1e-4), DroppedBytes(1e-3), DuplicatedChunk(0.1), Garbage(0.05)]


def sent(fault: SampleFault | None) -> list[Data]:
    device = demo_device("a", 1)
    device.sample_fault = fault
    packets = [decode(payload) for payload in Deframer().feed(device.advance(10.0))]
    return [packet for packet in packets if isinstance(packet, Data)]


def gyro_sent(fault: SampleFault | None) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    return np.concatenate([packet.gyro for packet in sent(fault)])


@pytest.mark.parametrize("fault", BYTE_FAULTS, ids=lambda fault: type(fault).__name__)
def test_a_byte_fault_costs_few_frames_and_forges_none(fault: ByteFault) -> None:
    device = demo_device("a", 1)
    clean, dirty = Deframer(), Deframer()
    whole, got = [], []
    for i in range(1, 1001):
        data = device.advance(i * 0.02)
        whole += clean.feed(data)
        got += dirty.feed(fault(data))
    assert fault.injected > 0
    assert set(got) <= set(whole)
    # Each strike ruins at most the frame it is in and, eating a boundary, the next.
    assert len(set(whole) - set(got)) <= 2 * fault.injected
    assert len(set(got)) > 0.5 * len(whole)


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


@pytest.mark.parametrize(("first", "n"), [(0, 3), (101, 200), (100, 7)])
def test_a_stuck_sensor_repeats_itself_on_all_axes_and_then_goes_on(first: int, n: int) -> None:
    fault = Stuck(first, n)
    clean, dirty = gyro_sent(None), gyro_sent(fault)
    struck = slice(first, first + n)
    np.testing.assert_array_equal(dirty[struck], np.repeat(clean[first : first + 1], n, axis=0))
    np.testing.assert_array_equal(np.delete(dirty, struck, axis=0), np.delete(clean, struck, axis=0))
    assert fault.injected == n


def test_a_temperature_leaps_and_comes_back() -> None:
    fault = TemperatureLeap(50, 20)
    clean, dirty = (np.concatenate([packet.temperature_c for packet in sent(one)]) for one in (None, fault))
    leapt = np.flatnonzero(dirty != clean)
    assert leapt.tolist() == list(range(50, 70))
    np.testing.assert_allclose(dirty[leapt] - clean[leapt], -60, atol=1e-4)
    assert fault.injected == 20


@pytest.mark.parametrize("at_most", [1, 3, 17])
def test_what_dribbles_comes_whole_and_in_order(at_most: int) -> None:
    device, fault = demo_device("a", 1), Dribble(at_most)
    clean, got = b"", []
    for i in range(1, 51):
        data = device.advance(i * 0.02)
        clean += data
        got.append(fault(data))
    while piece := fault(b""):
        got.append(piece)
    assert b"".join(got) == clean
    assert max(map(len, got)) == at_most
    assert fault.injected > 50


def test_a_dead_link_gives_everything_at_once_when_it_comes_back() -> None:
    fault = HeldUp()
    assert fault(b"a") == b"a"
    fault.dead = True
    assert fault(b"bc") + fault(b"d") == b""
    fault.dead = False
    assert fault(b"e") == b"bcde"
    assert fault(b"f") == b"f"
    assert fault.injected == 3
