"""Driver for WitMotion sensors (WT901, HWT905, JY901, WT901BLE …): reads angular rates and times, configures the device."""

from collections.abc import Sequence
from enum import StrEnum
from math import log

from bridge.drivers.byte_stream import OUTPUT, StreamOptions, stream_kind
from bridge.drivers.driver import Event, Notice
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler
from bridge.drivers.time_presence import TimePresence
from bridge.drivers.witmotion_samples import GYRO_RANGE, Cycles, Sample
from bridge.drivers.witmotion_settings import RATES_HZ, Settings
from bridge.framing.witmotion import MOTION_REGISTERS, REGISTERS, WitFrames
from bridge.reasons.codes import Code
from bridge.wire.refusal import Tally

UNSETTLED, UNTIMED = "samples_before_settled", "time_missing"
_MODEL = "WitMotion"
_FORGOTTEN = 8  # consecutive cycles without their time
_COUNTED_S = 1.0
_NO_RATE = 100  # frames
_BITS_A_CYCLE = 330  # time, acceleration and rate frames, at ten bits per byte
_FASTEST_HZ = 200.0


class Word(StrEnum):
    """Which frame of a WitMotion model carries the temperature as its fourth 16-bit word.

    ACCEL: the acceleration frame. GYRO: the frame of angular rates. NONE: no frame.
    """

    ACCEL = "accel"
    GYRO = "gyro"
    NONE = "none"


class WitMotionOptions(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a WitMotion sensor. Raises ValueError for an invalid option.

    rate_hz: output data rate to set, Hz; the device is then also set to send timestamps. 0 leaves the device as it is.
    keep_settings: True changes and queries nothing; rate_hz is then the rate that the device is known to send.
    temperature: frame in which this model sends the temperature.
    """

    #: speed of the serial port, bits per second, as set in the device; 9600 carries at most 20 samples a second
    baud: int = 9600
    #: output data rate to set in the device, Hz: 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100 or 200; 0 leaves the device's rate
    rate_hz: float = 0.0
    #: whether to leave the device's settings alone; `rate_hz` is then the rate that the device sends
    keep_settings: bool = False
    #: frame that carries the temperature on this model: `accel`, `gyro`, or `none` if no frame does
    temperature: Word = Word.ACCEL

    def __post_init__(self) -> None:
        super().__post_init__()
        rate_hz = self.rate_hz
        if rate_hz and rate_hz not in RATES_HZ.values():
            raise ValueError(f"rate_hz is {rate_hz:g}: use one of {', '.join(f'{one:g}' for one in RATES_HZ.values())}")
        if "://" not in self.port and rate_hz * _BITS_A_CYCLE > self.baud:
            need = f"{rate_hz * _BITS_A_CYCLE:.0f}"
            raise ValueError(
                f"rate_hz is {rate_hz:g}: set baud to {need} or more, here and in the device, or lower rate_hz"
            )


class WitMotionDecoder:
    """Decoder of WitMotion sensors, which also queries and configures the device. Without options it sends nothing.

    Until the decoder knows if the device sends timestamps, samples are dropped and counted in `faults`.
    """

    def __init__(self, options: WitMotionOptions | None = None) -> None:
        self.faults = Tally()
        self._options = options or WitMotionOptions(port="unknown", keep_settings=True)
        self._settings = Settings(self._options.rate_hz, writes=not self._options.keep_settings)
        self._frames = WitFrames(self.faults)
        self._cycles = Cycles(self.faults)
        self._timed = TimePresence()
        self._assembly = SampleAssembler(self.faults, DeviceDescription(_MODEL), None)  # replaced once settled
        self._boot = 0
        self.opened()

    def opened(self) -> None:
        """Reset the decoder for a newly opened port; the device will be queried again."""
        self._frames.opened()
        self._cycles.opened()
        self._assembly.opened()
        self._asked = False
        self._counted, self._since_ns = 0, 0
        self._without_rate = 0  # frames since the last sample

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        """
        events: list[Event] = []
        for frame in self._frames.feed(data):
            if frame.kind in (REGISTERS, MOTION_REGISTERS):
                events += self._answered(frame.data)
            elif (sample := self._cycles.take(frame)) is not None:
                if self._without_rate >= _NO_RATE:
                    events.append(Notice(OUTPUT, None))
                self._without_rate = 0
                self._take(sample, receive_time_ns)
            else:
                self._without_rate += 1
                if self._without_rate == _NO_RATE:
                    events.append(Notice(OUTPUT, Code.NO_RATE_OF_TURN()))
        if not self._asked and self._frames.checked is not None and not self._options.keep_settings:
            self._ask()
        events += self._settings.passed(receive_time_ns)
        return events + self._assembled()

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples that the decoder still holds back."""
        return self._assembly.finish()

    def to_send(self) -> bytes:
        """Return the bytes of the next command to the device, each command once; b"" if there is none."""
        return self._settings.command()

    def _ask(self) -> None:
        self._asked = True
        self._settings.begin(checked=bool(self._frames.checked))

    def _answered(self, data: bytes) -> Sequence[Event]:
        events = self._settings.took(data)
        self._assembly.about = self._about()
        return events

    def _take(self, sample: Sample, receive_time_ns: int) -> None:
        if not self._fits(timed=sample.time_ms is not None, now_ns=receive_time_ns):
            self.faults.add(UNSETTLED if self._timed.tells is None else UNTIMED)
            return
        celsius = self._celsius(sample)
        self._assembly.add(sample.time_ms or 0, sample.gyro, sample.accel, celsius, receive_time_ns=receive_time_ns)

    def _fits(self, *, timed: bool, now_ns: int) -> bool:
        """Return whether a sample with time (`timed`) or without can be assembled.

        It can once the device's way is decided.
        """
        if self._timed.fits(timed=timed):
            return True
        if self._timed.tells and self._timed.in_a_row == _FORGOTTEN and self._asked:
            self._assembly.rebooted()  # it was set to send its time, and the setting is lost with power
            self._ask()
        rate_hz = 0.0 if timed else self._promised_hz(now_ns)
        if not self._settled or not (timed or rate_hz) or not self._timed.settle():
            return False
        self._assembly = SampleAssembler(self.faults, self._about(rate_hz), 1e-3 if timed else None)
        return True

    @property
    def _settled(self) -> bool:
        return self._options.keep_settings or (self._asked and self._settings.settled)

    def _promised_hz(self, now_ns: int) -> float:
        """Rate of a device without time, in Hz; 0 while counting.

        It is the rate that the device reports, else the configured rate, else the setting nearest to the counted rate.
        """
        self._since_ns = self._since_ns or now_ns
        self._counted += 1
        if told_hz := self._settings.sends_hz or self._options.rate_hz:
            return told_hz
        passed_s = (now_ns - self._since_ns) * 1e-9
        if passed_s < _COUNTED_S:
            return 0.0
        counted_hz = (self._counted - 1) / passed_s
        return min(RATES_HZ.values(), key=lambda rate_hz: abs(log(rate_hz / max(counted_hz, 0.1))))

    def _assembled(self) -> list[Event]:
        if self._asked and self._settings.settled and self._boot not in (0, self._assembly.boot):
            self._ask()  # settings are lost in a reboot
        self._boot = self._assembly.boot
        return self._assembly.events()

    def _about(self, rate_hz: float | None = None) -> DeviceDescription:
        if rate_hz is None:
            rate_hz = 0.0 if self._timed.tells else self._assembly.about.rate_hz
        return DeviceDescription(_MODEL, self._settings.firmware, GYRO_RANGE, rate_hz, divided_hz=_FASTEST_HZ)

    def _celsius(self, sample: Sample) -> float | None:
        words = {Word.ACCEL: sample.accel_word, Word.GYRO: sample.gyro_word}
        word = words.get(self._options.temperature)
        return None if word is None else word / 100


KIND = stream_kind(
    "witmotion",
    "WitMotion's sensors, serial or Bluetooth: port, baud, rate_hz, keep_settings, temperature",
    WitMotionOptions,
    WitMotionDecoder,
)
