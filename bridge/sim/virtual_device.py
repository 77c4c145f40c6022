"""Virtual device that speaks the native serial protocol. Pure: no I/O, and time is an argument.

At power-up, the device draws a new boot number and is silent for 0.3 s. Then it sends HELLO, and DATA about every
20 ms. HELLO is repeated each second and on request. After a rate command, the next `advance` sends HELLO with the
new rate. Samples have this rate within a second, until power is lost.
"""

import zlib
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bridge.framing.cobs_frames import Deframer, frame
from bridge.framing.packets import (
    MAX_SAMPLES,
    Charge,
    Data,
    Hello,
    decode_rate,
    encode_battery,
    encode_data,
    encode_hello,
    encode_identify,
    encode_own,
)
from bridge.sim.imu_errors import DEMO_SPEC, ImuSpec
from bridge.sim.motion_scripts import demo_script
from bridge.sim.quaternion import Array
from bridge.sim.sample_source import Samples, SimulatedSource, Source
from bridge.sim.truth_log import TruthLog
from bridge.sim.ward_script import Life
from bridge.wire.messages import DeviceCalibration

TICK_S = 1e-6
_MASK_32 = 0xFFFFFFFF
_HELLO_EVERY_S = 1.0
_PACKET_S = 0.02


@dataclass(frozen=True, slots=True)
class DeviceSpec:
    """Properties of a virtual device, apart from its sensor.

    model, firmware: names that the device reports. silence_s: time from power-up to the first HELLO, s.
    skew_ppm: frequency error of the oscillator that times samples and ticks; positive is fast.
    first_tick: tick counter at power-up.
    wait_for_host: send HELLO but no DATA until the host first sends IDENTIFY, so that a replay loses no sample.
    truth_s: duration for which true values are stored, s.
    battery_s: time in which a full battery empties, s; 0 for a device that reports no battery.
    """

    model: str = "truerate-virtual"
    firmware: str = "1.0"
    silence_s: float = 0.3
    skew_ppm: float = 0.0
    first_tick: int = 0
    wait_for_host: bool = False
    truth_s: float = 300.0
    battery_s: float = 0.0


@dataclass(slots=True)
class _Boot:
    """State that is lost with power. Times are on the device's clock, s since power-up."""

    number: int
    begin_s: float  # true time of power-up
    next_hello_s: float
    stream_s: float | None = None  # when streaming began
    read: int = 0  # samples taken from the source
    sent: int = 0
    ended: bool = False
    own: DeviceCalibration | None = None
    ready: Samples | None = None  # taken from the source, not yet sent


class VirtualDevice:
    """Virtual device that speaks the native serial protocol: `receive` takes bytes, `advance` returns bytes.

    Call `advance` and `receive` from one thread. `reboot`, `power_off`, `power_on` and `truth` (the log of true values)
    may be used from any thread.
    name, seed: decide all random values together. draw_boot: function that returns a 64-bit boot number at each
    power-up; None draws boot numbers from the seed too.
    source: supplies the samples. spec: properties of the device; None for DeviceSpec().
    """

    def __init__(
        self,
        name: str,
        source: Source,
        seed: int = 0,
        spec: DeviceSpec | None = None,
        draw_boot: Callable[[], int] | None = None,
    ) -> None:
        self.name = name
        self.spec = spec or DeviceSpec()
        self._source = source
        self._draw_boot = draw_boot
        self._rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        #: true sensor parameters of each boot, and truth of the latest samples
        self.truth = TruthLog(round(self.spec.truth_s * source.sensor.rate_hz))
        self._clock_pace = 1 + self.spec.skew_ppm * 1e-6
        self._deframer = Deframer()
        self._asked = self._host_seen = False
        self._rate_hz: float | None  # rate command not yet obeyed
        self._switches: deque[bool] = deque()
        self._time_s = 0.0
        #: number of samples sent, by boot number
        self.sent: dict[int, int] = {}
        self._now: _Boot | None = self._power_up()

    @property
    def boot(self) -> int | None:
        """Number (64 bits) of the current boot; None while the device is off."""
        return None if self._now is None else self._now.number

    @property
    def finished(self) -> bool:
        """True if the device's source has ended and all its samples have been sent."""
        return self._now is not None and self._now.ended and not self._now.ready

    def reboot(self) -> None:
        """Switch the device off and on again at the next `advance`."""
        self._switches.extend([False, True])

    def power_off(self) -> None:
        """Switch the device off at the next `advance`; the device sends nothing while off."""
        self._switches.append(False)

    def power_on(self) -> None:
        """Switch the device on at the next `advance`, which starts a boot; does nothing if on."""
        self._switches.append(True)

    def calibrates_itself(self, scale: Array, bias: Array) -> None:
        """Let the device send a calibration that it made itself, with each HELLO of this boot.

        scale (3,): without unit. bias (3,): rad/s. Does nothing while the device is off.
        """
        if self._now is not None:
            now = self._now
            now.own = DeviceCalibration(now.number, now.sent & _MASK_32, tuple(scale.tolist()), tuple(bias.tolist()))

    def receive(self, data: bytes) -> None:
        """Process bytes from the host, such as identify and rate commands; the next `advance` returns the answers."""
        for payload in self._deframer.feed(data):
            if payload == encode_identify():
                self._asked = self._host_seen = True
            elif (rate_hz := decode_rate(payload)) is not None:
                self._rate_hz = rate_hz

    def advance(self, time_s: float) -> bytes:
        """Run the device until time_s, and return the bytes that it sent since the last call.

        time_s: true time since the device was made, s; never less than before.
        """
        while self._switches:
            self._switch(on=self._switches.popleft())
        before_s, self._time_s = self._time_s, time_s
        now = self._now
        if now is None:
            return b""
        last_clock_s, clock_s = ((at - now.begin_s) * self._clock_pace for at in (before_s, time_s))
        if clock_s < self.spec.silence_s:
            return b""
        if now.stream_s is None and (self._host_seen or not self.spec.wait_for_host):
            now.stream_s = max(self.spec.silence_s, last_clock_s)
        if self._rate_hz is not None:
            self._source.pace(self._rate_hz)
            self._rate_hz, self._asked = None, True
        out = []
        if self._asked:
            self._asked = False
            out.append(self._hello(now))
        if now.stream_s is not None:
            for packet_clock_s, packet in self._packets(now, now.stream_s, clock_s):
                out += self._hellos(now, packet_clock_s)
                out.append(packet)
        out += self._hellos(now, clock_s)
        return b"".join(out)

    def _switch(self, *, on: bool) -> None:
        if on and self._now is None:
            self._now = self._power_up()
        elif not on:
            self._now = None

    def _power_up(self) -> _Boot:
        self._rate_hz = None
        # always drawn, so that later draws depend on the seed only
        boot = int(self._rng.integers(2**64, dtype=np.uint64))
        if self._draw_boot is not None:
            boot = self._draw_boot()
        self.truth.begin(boot, self._source.power_up(self._rng.spawn(1)[0], 1 / self._clock_pace))
        return _Boot(boot, self._time_s, self.spec.silence_s)

    def _hello(self, now: _Boot) -> bytes:
        sensor = self._source.sensor
        hello = Hello(
            boot=now.number,
            tick_period_s=TICK_S,
            rate_hz=sensor.rate_hz,
            gyro_range=sensor.gyro_range,
            has_accel=sensor.has_accel,
            has_temperature=sensor.has_temperature,
            model=self.spec.model,
            firmware=self.spec.firmware,
        )
        own = b"" if now.own is None else frame(encode_own(now.own))
        battery = b""
        if self.spec.battery_s:
            left = max(0.0, 1 - (self._time_s - now.begin_s) / self.spec.battery_s)
            battery = frame(encode_battery(Charge(round(100 * left), charging=False)))
        return frame(encode_hello(hello)) + own + battery

    def _hellos(self, now: _Boot, clock_s: float) -> list[bytes]:
        """HELLO frames due by clock_s."""
        hellos = []
        while now.next_hello_s <= clock_s:
            now.next_hello_s += _HELLO_EVERY_S
            hellos.append(self._hello(now))
        return hellos

    def _packets(self, now: _Boot, stream_s: float, clock_s: float) -> Iterator[tuple[float, bytes]]:
        """DATA frames complete by clock_s, each with the time of its last sample."""
        per_packet = int(np.clip(round(_PACKET_S * self._source.sensor.rate_hz), 1, MAX_SAMPLES))
        while True:
            ready = self._ready(now, per_packet)
            if ready is None:
                return
            samples = ready[:per_packet]
            complete_s = stream_s + float(samples.clock_s[-1])
            if complete_s > clock_s:
                return
            now.ready = ready[len(samples) :]
            yield complete_s, self._data(now, stream_s, samples)

    def _ready(self, now: _Boot, per_packet: int) -> Samples | None:
        """At least a packet of samples; fewer at the end of a recording, None after it."""
        while not now.ended and (now.ready is None or len(now.ready) < per_packet):
            more = self._source.read()
            if more is None:
                now.ended = True
                break
            if more.truth is not None:
                self.truth.add(now.number, now.read, more.truth)
            now.read += len(more)
            now.ready = more if not now.ready else now.ready.joined(more)
        return now.ready or None

    def _data(self, now: _Boot, stream_s: float, samples: Samples) -> bytes:
        ticks = self.spec.first_tick + np.round((stream_s + samples.clock_s) / TICK_S).astype(np.int64)
        data = Data(
            boot=now.number,
            sequence=now.sent & _MASK_32,
            ticks=(ticks & _MASK_32).astype(np.uint32),
            gyro=samples.gyro.astype(np.float32),
            accel=samples.accel.astype(np.float32),
            temperature_c=samples.temperature_c.astype(np.float32),
        )
        now.sent += len(samples)
        self.sent[now.number] = now.sent
        return frame(encode_data(data))


def demo_device(
    name: str,
    seed: int,
    *,
    imu: ImuSpec = DEMO_SPEC,
    rate_hz: float = 104.0,
    spec: DeviceSpec | None = None,
    draw_boot: Callable[[], int] | None = None,
    script: Callable[[np.random.Generator], Life] = demo_script,
) -> VirtualDevice:
    """Make a virtual device that rests for 2 s at each boot, is calibrated by hand within 30 s, then is worn forever.

    name, seed, spec, draw_boot: as in VirtualDevice. imu: error limits of the sensor. rate_hz: output data rate.
    script: makes the motion of a boot from a random generator, instead of demo_script.
    """
    return VirtualDevice(name, SimulatedSource(script, imu, rate_hz), seed, spec, draw_boot)
