"""Driver for devices that use truerate's own serial protocol (`bridge.framing.packets`)."""

from collections import deque

from bridge.drivers.byte_stream import StreamOptions, stream_kind
from bridge.drivers.driver import Battery, Event, Identity, Readings
from bridge.framing import packets
from bridge.framing.cobs_frames import Deframer, frame
from bridge.wire.messages import BootCause, DeviceCalibration
from bridge.wire.refusal import Tally

ASK = frame(packets.encode_identify())
_MAX_HELD = 64  # packets of an unknown boot that are kept: over a second at the usual 50 a second
_ASK_AGAIN = 16  # packets


class NativeOptions(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a device that uses truerate's own serial protocol. Raises ValueError for an invalid output data rate."""

    #: output data rate to set in the device, Hz, 0.1 to 100000, for example 104; 0 leaves the device's rate unchanged
    rate_hz: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate_hz and not 0.1 <= self.rate_hz <= 100_000:
            raise ValueError(f"rate_hz is {self.rate_hz:g}: use 0.1 to 100000")


class NativeDecoder:
    """Decoder of truerate's own serial protocol. It also requests the device's identity and sets its output data rate.

    rate_hz: output data rate to set, Hz; 0 leaves the device's rate.
    Each packet of samples carries a boot number. Packets are held until the device has sent the identity with the same
    boot number. They are dropped if an identity with another boot number arrives or the stream ends. At most 64 packets
    are held; the oldest is dropped for a new one.
    `faults` counts the dropped samples.
    """

    def __init__(self, rate_hz: float = 0.0) -> None:
        self.faults = Tally()
        self._wanted_hz = rate_hz
        self._held: deque[tuple[packets.Data, int]] = deque()  # packet, receive time in ns
        self.opened()

    def opened(self) -> None:
        """Reset the decoder for a newly opened port, and request the device's identity."""
        self._ask = True
        self._deframer = Deframer()
        self._deframer.faults = self.faults
        self._boot: int | None = None
        self.finish()
        self._unknown = 0  # packets of an unknown boot since the last HELLO
        self._tell = False  # the rate is to be sent

    def finish(self) -> list[Event]:
        """End the stream: count the held packets as lost, because their identity can no longer arrive; return []."""
        held, self._held = self._held, deque()
        self._forget(sum(len(data.ticks) for data, _ in held))
        return []

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        """
        events: list[Event] = []
        for payload in self._deframer.feed(data):
            try:
                packet = packets.decode(payload)
            except packets.BadPacket as bad:
                self.faults.add(bad.label)
                continue
            if isinstance(packet, packets.Hello):
                events += self._greeted(packet)
            elif isinstance(packet, DeviceCalibration):
                events.append(packet)
            elif isinstance(packet, packets.Charge):
                events.append(Battery(packet.percent, packet.charging))
            else:
                events += self._read(packet, receive_time_ns)
        return events

    def to_send(self) -> bytes:
        """Return the bytes of the commands that are due: identity request, then output data rate; b"" if neither is due.

        Each command is returned once.
        """
        ask, self._ask = self._ask, False
        tell, self._tell = self._tell, False
        return (ASK if ask else b"") + (frame(packets.encode_rate(self._wanted_hz)) if tell else b"")

    def _greeted(self, hello: packets.Hello) -> list[Event]:
        self._boot = hello.boot
        self._ask = False
        self._tell = self._wanted_hz not in (0, hello.rate_hz)
        self._unknown = 0
        identity = Identity(
            boot=hello.boot,
            boot_cause=BootCause.POWER_UP,
            model=hello.model,
            firmware=hello.firmware,
            rate_hz=hello.rate_hz,
            gyro_range=hello.gyro_range,
            tick_period_s=hello.tick_period_s,
            has_accel=hello.has_accel,
            has_temperature=hello.has_temperature,
        )
        held, self._held = self._held, deque()
        mine = [_readings(data, came_ns, hello) for data, came_ns in held if data.boot == hello.boot]
        self._forget(sum(len(data.ticks) for data, _ in held if data.boot != hello.boot))
        self._hello = hello
        return [identity, *mine]

    def _read(self, data: packets.Data, receive_time_ns: int) -> list[Event]:
        if data.boot == self._boot:
            return [_readings(data, receive_time_ns, self._hello)]
        if len(self._held) == _MAX_HELD:
            self._forget(len(self._held.popleft()[0].ticks))
        self._held.append((data, receive_time_ns))
        # Ask at the first packet of an unknown boot, and again if no answer comes.
        if self._unknown % _ASK_AGAIN == 0:
            self._ask = True
        self._unknown += 1
        return []

    def _forget(self, samples: int) -> None:
        if samples:
            self.faults.add("samples_of_unknown_boot", samples)


def _readings(data: packets.Data, receive_time_ns: int, hello: packets.Hello) -> Readings:
    """Readings of a data packet, with only the columns that the device measures."""
    return Readings(
        data.boot,
        data.sequence,
        receive_time_ns,
        data.ticks,
        data.gyro,
        data.accel if hello.has_accel else None,
        data.temperature_c if hello.has_temperature else None,
    )


def _decoder(options: StreamOptions | None) -> NativeDecoder:
    if isinstance(options, NativeOptions):
        return NativeDecoder(options.rate_hz)
    return NativeDecoder()


KIND = stream_kind(
    "native",
    "truerate's own serial protocol (COBS frames with a CRC-32): port, baud, rate_hz",
    NativeOptions,
    _decoder,
)
