"""Driver for Xsens (Movella) motion trackers that send MTData2 messages: MTi 1-, 10-, 100- and 600-series."""

from math import radians

from bridge.drivers.byte_stream import OUTPUT, StreamOptions, stream_kind
from bridge.drivers.driver import Event, Notice
from bridge.drivers.mtdata2_settings import Settings
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler
from bridge.drivers.time_presence import TimePresence
from bridge.framing import mtdata2
from bridge.framing.mtdata2 import Data, Message, Messages
from bridge.framing.packets import BadPacket
from bridge.reasons.codes import Code
from bridge.wire.refusal import Tally

UNSETTLED, UNTIMED = "samples_before_settled", "time_missing"
MISSING, CLIPPED = "missing_messages", "clipped_by_its_own_word"
TICK_S = 1e-4
_MODEL = "Xsens MT"
_COUNTS = 1 << 16
_REORDERED = _COUNTS // 2  # a larger step means that the counter went back
_BITS = 620  # of a message with the configured output, ten bits per byte
_NO_RATE = 50  # messages


class MtData2Options(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of an Xsens motion tracker.

    ask: True queries model and firmware; the device stops measuring for a moment.
    rate_hz: output data rate to set, Hz, which the device stores; 0 leaves the device's output as it is.
    gyro_range_dps: full-scale range in °/s; 0 if unknown. Raises ValueError for an invalid option.
    """

    #: whether to query the device's model and firmware; the device stops measuring for a moment
    ask: bool = False
    #: output data rate to set in the device, Hz, 1 to 2000, for example 100; 0 leaves the device's output as it is
    rate_hz: int = 0
    #: full-scale range of the gyro, °/s, for example 2000; 0 if unknown
    gyro_range_dps: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate_hz and not 1 <= self.rate_hz <= 2000:
            raise ValueError(f"rate_hz is {self.rate_hz}: use 1 to 2000")
        if "://" not in self.port and self.rate_hz * _BITS > self.baud:
            need = f"{self.rate_hz * _BITS}"
            raise ValueError(
                f"rate_hz is {self.rate_hz}: set baud to {need} or more, here and in the device, or lower rate_hz"
            )
        if not 0 <= self.gyro_range_dps <= 50_000:
            raise ValueError(f"gyro_range_dps is {self.gyro_range_dps:g}: use 0 (unknown) to 50000")


class MtData2Decoder:
    """Decoder of MTData2, the messages of Xsens motion trackers. Without options it sends nothing to the device.

    Until the decoder knows if the device sends timestamps, samples are dropped and counted in `faults`.
    """

    def __init__(self, options: MtData2Options | None = None) -> None:
        self.faults = Tally()
        self._options = options or MtData2Options(port="unknown")
        self._asks = self._options.ask or self._options.rate_hz > 0
        self._settings = Settings(self._options.rate_hz)
        self._messages = Messages(self.faults)
        self._timed = TimePresence()
        self._assembly = SampleAssembler(self.faults, self._about(), None)  # replaced once settled
        self._celsius: float | None = None
        self._without_rate = 0
        self.opened()

    def opened(self) -> None:
        """Reset the decoder for a newly opened port, and query the device again if its options ask for it."""
        self._messages.opened()
        self._assembly.opened()
        self._counter: int | None = None
        self._before: tuple[int, int] | None = None  # time and counter of the previous message
        self._step = 0  # ticks from one message to the next
        self._lost = 0  # messages lost since the last sample
        if self._asks:
            self._settings.begin()

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        """
        events: list[Event] = []
        for message in self._messages.feed(data):
            events += self._took(message, receive_time_ns)
        events += self._settings.passed(receive_time_ns)
        return events + self._assembly.events()

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples that the decoder still holds back."""
        return self._assembly.finish()

    def to_send(self) -> bytes:
        """Return the bytes of the next command to the device, each command once; b"" if there is none."""
        return self._settings.command()

    def _took(self, message: Message, receive_time_ns: int) -> list[Notice]:
        if message.kind == mtdata2.MTDATA2:
            try:
                return self._measured(mtdata2.decode(message.data), receive_time_ns)
            except BadPacket as bad:
                self.faults.add(bad.label)
                return []
        if message.kind == mtdata2.MTDATA:
            return [Notice(OUTPUT, Code.LEGACY_MTDATA())]
        if message.kind == mtdata2.WAKE_UP:
            self._woke()
            return []
        notices = self._settings.took(message)
        if message.kind == mtdata2.GOTO_MEASUREMENT + 1:
            self._counter = None  # the counter restarts
        self._assembly.about = self._about()
        return notices

    def _woke(self) -> None:
        """Handle the WakeUp message: the device has booted."""
        self._counter, self._lost = None, 0
        self._assembly.rebooted()
        if self._asks:
            self._settings.begin(woken=True)

    def _measured(self, data: Data, receive_time_ns: int) -> list[Notice]:
        self._settings.measures()
        self._count(data.counter)
        if data.celsius is not None:
            self._celsius = data.celsius
        data = self._with_rate(data)
        if data.gyro is None:
            self._without_rate += 1
            lacking = self._without_rate == _NO_RATE
            why = Code.RAW_COUNTS if data.raw else Code.NO_RATE_OF_TURN
            return [Notice(OUTPUT, why())] if lacking else []
        notices = [Notice(OUTPUT, None)] if self._without_rate >= _NO_RATE else []
        self._without_rate = 0
        if data.gyro_clipped:
            self.faults.add(CLIPPED)
        lost, self._lost = self._lost, 0
        fits = self._timed.fits(timed=data.time is not None)
        if not fits and self._settings.settled and self._timed.settle():
            self._assembly = SampleAssembler(self.faults, self._about(), TICK_S if self._timed.tells else None, 32)
            fits = True
        if not fits:
            self.faults.add(UNSETTLED if self._timed.tells is None else UNTIMED)
            return notices
        self._assembly.add(
            data.time or 0,
            data.gyro,
            data.accel,
            self._celsius,
            receive_time_ns=receive_time_ns,
            missing=lost,
            clipped=data.gyro_clipped,
        )
        return notices

    def _with_rate(self, data: Data) -> Data:
        """Data with rate and acceleration from Δq, Δv and the time since the previous message, where it has no direct rate."""
        if data.gyro is not None or data.turned is None or data.time is None:
            return data
        before, self._before = self._before, (data.time, data.counter or 0)
        if before is not None and data.counter in (None, (before[1] + 1) % _COUNTS):
            self._step = (data.time - before[0]) % (1 << 32)
        if not self._step:
            return data
        per_s = 1 / (self._step * TICK_S)
        gyro = data.turned[0] * per_s, data.turned[1] * per_s, data.turned[2] * per_s
        sped = data.sped
        accel = data.accel if sped is None else (sped[0] * per_s, sped[1] * per_s, sped[2] * per_s)
        return data._replace(gyro=gyro, accel=accel)

    def _count(self, counter: int | None) -> None:
        """Follow the message counter, and count missing messages."""
        if counter is None:
            return
        if self._counter is not None:
            missing = (counter - self._counter - 1) % _COUNTS
            if 0 < missing < _REORDERED:
                self.faults.add(MISSING, missing)
                self._lost += missing
        self._counter = counter

    def _about(self) -> DeviceDescription:
        settings, range_dps = self._settings, self._options.gyro_range_dps
        return DeviceDescription(settings.model or _MODEL, settings.firmware, radians(range_dps), settings.sends_hz)


KIND = stream_kind(
    "mtdata2",
    "Xsens' motion trackers, MTData2: port, baud, ask, rate_hz, gyro_range_dps",
    MtData2Options,
    MtData2Decoder,
)
