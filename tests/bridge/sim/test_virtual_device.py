import numpy as np
import pytest

from bridge.framing.cobs_frames import Deframer, frame
from bridge.framing.packets import Charge, Data, Hello, decode, encode_identify, encode_rate
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice, demo_device
from bridge.wire.messages import DeviceCalibration
from tests.sim.recorded_source import RecordedSource

ASK = frame(encode_identify())


class Host:
    """Hears a device step by step and sorts what it says."""

    def __init__(self, device: VirtualDevice, step_s: float = 0.02) -> None:
        self.device = device
        self.said: list[Hello | Data | DeviceCalibration | Charge] = []
        self._deframer = Deframer()
        self._step_s = step_s
        self._steps = 0

    def hear(self, duration_s: float) -> list[Hello | Data | DeviceCalibration | Charge]:
        new = []
        for _ in range(round(duration_s / self._step_s)):
            self._steps += 1
            new += [decode(payload) for payload in self._deframer.feed(self.device.advance(self._steps * self._step_s))]
        assert not self._deframer.faults.as_dict()
        self.said += new
        return new

    def data(self, boot: int | None = None) -> list[Data]:
        return [one for one in self.said if isinstance(one, Data) and boot in {None, one.boot}]

    def hellos(self) -> list[Hello]:
        return [one for one in self.said if isinstance(one, Hello)]


def ticks_of(packets: list[Data]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.concatenate([packet.ticks for packet in packets]).astype(np.int64)


def test_a_boot_is_silence_then_hello_then_data() -> None:
    host = Host(demo_device("a", 1))
    assert host.hear(0.28) == []
    host.hear(3.0)
    first, second = host.said[:2]
    assert isinstance(first, Hello)
    assert isinstance(second, Data)
    assert (first.boot, second.sequence) == (second.boot, 0)
    assert first.tick_period_s == 1e-6
    assert first.gyro_range == pytest.approx(np.radians(500))
    assert len(host.hellos()) == 3  # at 0.3, 1.3 and 2.3 s


def test_a_rate_that_it_is_told_comes_within_a_second_and_goes_with_power() -> None:
    host = Host(demo_device("a", 1, rate_hz=50.0))
    host.hear(3.0)
    host.device.receive(frame(encode_rate(200.0)))
    host.device.receive(frame(encode_rate(0.0)))
    host.hear(3.0)
    host.device.receive(frame(encode_rate(50.0)))
    host.hear(3.0)
    steps = np.diff(ticks_of(host.data()))
    assert set(steps.tolist()) == {20_000, 5_000}
    assert np.count_nonzero(np.diff(steps)) == 2, "up once, down once"
    assert np.count_nonzero(steps == 5_000) == pytest.approx(600, abs=210)
    assert [hello.rate_hz for hello in host.hellos()] == [50.0] * 3 + [200.0] * 4 + [50.0] * 4
    host.device.receive(frame(encode_rate(200.0)))
    host.device.reboot()
    host.hear(2.0)
    assert host.hellos()[-1].rate_hz == 50.0


def test_switched_off_it_is_silent_and_deaf() -> None:
    host = Host(demo_device("a", 1))
    host.hear(1.0)
    host.device.power_off()
    assert host.hear(2.0) == []
    assert host.device.boot is None
    host.device.power_on()
    assert host.hear(0.28) == []
    assert isinstance(host.hear(0.1)[0], Hello)
    host.device.power_on()
    boot = host.device.boot
    host.hear(0.1)
    assert host.device.boot == boot


def test_a_recording_arrives_whole_once_the_host_asked() -> None:
    rng = np.random.default_rng(0)
    gyro, accel = rng.normal(size=(2, 501, 3)).astype(np.float32)
    time_s = np.cumsum(rng.uniform(0.005, 0.015, 501)) + 1e4
    source = RecordedSource(gyro, accel, rate_hz=100, time_s=time_s)
    host = Host(VirtualDevice("a", source, spec=DeviceSpec(wait_for_host=True)))
    host.hear(5.0)
    assert not host.data()
    assert host.hellos()
    host.device.receive(ASK)
    host.hear(10.0)
    np.testing.assert_array_equal(np.concatenate([one.gyro for one in host.data()]), gyro)
    np.testing.assert_array_equal(np.concatenate([one.accel for one in host.data()]), accel)
    np.testing.assert_allclose(np.diff(ticks_of(host.data())) * 1e-6, np.diff(time_s), atol=2e-6)
    assert host.device.finished
    assert not host.hellos()[0].has_temperature
    assert host.hellos()[0].has_accel


def test_however_time_is_cut_it_says_the_same() -> None:
    def life(steps: int) -> bytes:
        device = demo_device("a", 3)
        return b"".join(device.advance((i + 1) * 8.0 / steps) for i in range(steps))

    assert life(1) == life(7) == life(1600)
