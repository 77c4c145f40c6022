"""Driver for x-io Technologies' x-IMU3 and compatible devices, over USB, serial, TCP, UDP, or from a file."""

from collections import deque
from math import radians

from bridge.drivers.byte_stream import StreamOptions, stream_kind
from bridge.drivers.driver import Battery, Event, Identity, Notice
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler, Vector
from bridge.drivers.ximu3_settings import SAMPLES_HZ, Settings
from bridge.framing.lines import Line, Lines
from bridge.framing.packets import BadPacket, Charge
from bridge.framing.ximu3 import LONGEST, Inertial, Message, Reply, Said, Temperature, decode
from bridge.reasons.codes import Code
from bridge.wire.refusal import Tally

_G = 9.80665
_GYRO_RANGE = radians(2000.0)
UNSETTLED = "samples_before_settled"
_MODEL = "x-IMU3"
_REMEMBERED = 3  # messages of each kind, shown to people
_PATIENCE_NS = 1_000_000_000  # to wait for the device's answers
_SEEN = 0.1  # relative tolerance for recognising a new sample period


class Ximu3Options(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of an x-IMU3. Raises ValueError for an invalid output data rate.

    rate_hz: output data rate to set, 400 Hz divided by a whole number; None leaves the device's rate. A serial line at
    115200 baud carries at most 200 Hz.
    keep_settings: True queries the device but changes no setting.
    """

    #: output data rate to set in the device, Hz: 400 divided by a whole number, for example 100; default: the device's rate
    rate_hz: float | None = None
    #: whether to leave the device's settings alone; truerate then only queries them
    keep_settings: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate_hz is not None and not 1 <= self.rate_hz <= SAMPLES_HZ:
            raise ValueError(f"rate_hz is {self.rate_hz:g}: use 1 to {SAMPLES_HZ:g}")


class Ximu3Decoder:
    """Decoder of the x-IMU3. It queries the identity, turns the on-board bias correction off and sets the output data rate.

    Samples are dropped and counted until the device has answered, for at most one second. Without options, and if
    the port is a file, the decoder sends nothing.
    """

    def __init__(self, options: Ximu3Options | None = None) -> None:
        self.faults = Tally()
        self._asks = options is not None and not options.port.startswith("file://")
        writes = options is not None and self._asks and not options.keep_settings
        self._settings = Settings(options.rate_hz if options else None, writes=writes)
        self._lines = Lines(LONGEST)
        self._assembly = SampleAssembler(self.faults, self._about(), 1e-6)
        self._said = {error: deque[str](maxlen=_REMEMBERED) for error in (False, True)}
        self._temperature_c: float | None = None
        self._time_us = 0  # device time of the latest sample
        self._boot = 0
        self.opened()

    def opened(self) -> None:
        """Reset the decoder for a newly opened port, and query the device again."""
        self._lines.opened()
        self._assembly.opened()
        self._ask()
        self._temperature_c = None
        self._first_ns = 0  # arrival of the first sample since the port was opened

    def _ask(self) -> None:
        if self._asks:
            self._settings.ask()

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        """
        events: list[Event] = []
        for line in self._lines.feed(data):
            try:
                message = _decoded(line)
            except BadPacket as bad:
                self.faults.add(bad.label)
                continue
            if message is not None:
                events += self._took(message, receive_time_ns)
        events += self._settings.passed(receive_time_ns)
        assembled = self._assembly.events()
        for event in assembled:
            if isinstance(event, Identity) and event.boot != self._boot:
                if self._boot:
                    self._ask()  # unsaved settings are lost in a reboot
                self._boot = event.boot
        return events + assembled

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples still held back, even if the sample rate is unknown."""
        return self._assembly.finish()

    def to_send(self) -> bytes:
        """Return the bytes of the next command, b"" if there is none. Commands are sent singly, so that each fits a datagram."""
        return self._settings.command()

    def _took(self, message: Message, receive_time_ns: int) -> list[Event]:
        match message:
            case Inertial():
                self._sample(message, receive_time_ns)
            case Temperature():
                self._temperature_c = message.celsius
            case Charge():
                return [Battery(message.percent, message.charging)]
            case Said():
                said = self._said[message.error]
                said.append(message.text)
                words = " | ".join(said)
                if message.error:
                    return [Notice("error", Code.DEVICE_REPORTS_ERROR(words=words))]
                return [Notice("notification", Code.DEVICE_SAYS(words=words))]
            case Reply():
                notices = self._settings.took(message)
                self._assembly.about = self._about()
                return list(notices)
        return []

    def _sample(self, sample: Inertial, receive_time_ns: int) -> None:
        if not self._first_ns:
            self._first_ns = receive_time_ns
            if self._settings.key is not None or not self._settings.name:
                self._ask()  # questions sent before the device's first data may have been lost
        coming_us, step_us, self._time_us = self._settings.coming_us, sample.time_us - self._time_us, sample.time_us
        if coming_us is not None and abs(step_us / coming_us - 1) < _SEEN:
            self._settings.coming_us = None
            self._assembly.paced(1e6 / coming_us)
        if self._waits(receive_time_ns):
            self.faults.add(UNSETTLED)
            return
        self._assembly.add(
            sample.time_us,
            _scaled(sample.gyro_dps, radians(1.0)),
            _scaled(sample.accel_g, _G),
            self._temperature_c,
            receive_time_ns=receive_time_ns,
        )

    def _waits(self, now_ns: int) -> bool:
        """Return whether the device is not identified and set yet; a stored calibration is looked up by the name."""
        waits = not self._boot and self._settings.key is not None
        return waits and now_ns - self._first_ns < _PATIENCE_NS

    def _about(self) -> DeviceDescription:
        settings = self._settings
        hardware = f" (hardware {settings.hardware})" if settings.hardware else ""
        return DeviceDescription(
            model=f"{settings.name or _MODEL} {settings.serial}".rstrip(),
            firmware=settings.firmware + hardware,
            gyro_range=_GYRO_RANGE,
            divided_hz=SAMPLES_HZ,
        )


def _decoded(line: Line) -> Message | None:
    if line.too_long:
        raise BadPacket("line_too_long")
    return decode(line.data)


def _scaled(vector: Vector, by: float) -> Vector:
    return vector[0] * by, vector[1] * by, vector[2] * by


KIND = stream_kind(
    "ximu3",
    "x-io's x-IMU3, and devices with the same protocol, binary or ASCII: port, baud, rate_hz, keep_settings",
    Ximu3Options,
    Ximu3Decoder,
)
