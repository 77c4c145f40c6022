"""Driver for Shimmer3 sensors with LogAndStream firmware, over Bluetooth's serial port (RFCOMM) or Bluetooth Low Energy.

The device streams only on command. The driver queries the device's channels and calibration, turns the checksum (CRC)
on, and starts the stream. After 3 s without samples, it does so again.
"""

from collections.abc import Callable
from math import radians
from typing import Final

from bridge.drivers.byte_stream import OUTPUT, StreamOptions, stream_kind
from bridge.drivers.driver import Event, Notice
from bridge.drivers.request_queue import RequestQueue
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler, Vector
from bridge.drivers.shimmer3_calibration import BYTES, RANGES_DPS, Calibration, battery
from bridge.framing import shimmer3 as framing
from bridge.framing.shimmer3 import TICKS_A_S, TIME_BITS, Frame, ShimmerFrames
from bridge.reasons.codes import Code
from bridge.wire.refusal import Tally

UNSETTLED, UNKNOWN_CHANNEL = "samples_before_settled", "unknown_channel"
GYRO: Final = (0x0A, 0x0B, 0x0C)
_LOW_NOISE, _WIDE_RANGE = (0x00, 0x01, 0x02), (0x04, 0x05, 0x06)
_BLOCKS = {_LOW_NOISE: 0, GYRO: 1, _WIDE_RANGE: 3}  # places in the answer of all calibrations
#: bytes of each channel's value in a data packet
_WIDTHS = dict.fromkeys(range(41), 2) | {0x1B: 3, 0x1D: 1, 0x20: 1} | dict.fromkeys((0x1E, 0x1F, 0x21, 0x22), 3)
_TIME_BYTES = 3
_AGAIN_S, _TIMES = 1.0, 3
_SILENT_NS, _BATTERY_NS = 3_000_000_000, 60_000_000_000
_SHIMMER3 = 3
_SENSORS = bytes((0xC0, 0x00, 0x00))  # low-noise accelerometer, gyro
_LARGEST = 32_767
_STOP, _START, _CRC = "stop", "start", "crc"

Reading = Callable[[bytes], tuple[int, int, int]]


class Shimmer3Options(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a Shimmer3 sensor: port, and output data rate in Hz. Raises ValueError for an invalid option."""

    #: `/dev/rfcomm0`, or `ble://address/49535343-1e4d-4bd9-ba61-23c647249616?write=49535343-8841-43f4-a8d4-ecbe34729bb3`
    port: str
    #: output data rate to set in the device, Hz, 1 to 1024, for example 102.4, together with gyro and accelerometer as
    #: the only sensors; 0 leaves the device as it is
    rate_hz: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate_hz and not 1 <= self.rate_hz <= 1024:
            raise ValueError(f"rate_hz is {self.rate_hz:g}: use 1 to 1024")


class Shimmer3Decoder:
    """Decoder of a Shimmer3 sensor, which also queries the device and starts its stream.

    Without options, and if the port is a file, it sends nothing. Samples are then decoded only after the received bytes
    have contained the device's answers that describe the layout of the samples.
    """

    def __init__(self, options: Shimmer3Options | None = None) -> None:
        self.faults = Tally()
        self._needs_crc = options is not None and options.port.startswith("ble://")
        self._asks = options is not None and not options.port.startswith("file://")
        self._ticks = round(TICKS_A_S / options.rate_hz) if options is not None and options.rate_hz else 0
        self._frames = ShimmerFrames(self.faults)
        self._requests = RequestQueue(_AGAIN_S, _TIMES, self._unanswered)
        self._firmware, self._rate_hz, self._range = "", 0.0, 0
        self._calibrations: dict[tuple[int, int, int], Calibration | None] = {}
        self._gyro: Reading | None = None
        self._accel: tuple[Reading, Calibration] | None = None
        self._assembly = SampleAssembler(self.faults, self._about(), 1 / TICKS_A_S, TIME_BITS)
        self.opened()

    def opened(self) -> None:
        """Reset the decoder for a newly opened port; queue the queries and the start of the stream again."""
        self._frames.opened()
        self._assembly.opened()
        self._heard_ns = self._battery_ns = 0
        self._begin()

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        After 3 s without samples, the commands that start the stream are queued again.
        """
        events: list[Event] = []
        self._frames.awaiting_ack = self._awaits_ack()
        for frame in self._frames.feed(data):
            events += self._took(frame, receive_time_ns)
            self._frames.awaiting_ack = self._awaits_ack()
        if self._heard_ns and receive_time_ns - self._heard_ns > _SILENT_NS:
            self._heard_ns = 0
            self._begin()
        elif self._asks and self._heard_ns and receive_time_ns - self._battery_ns > _BATTERY_NS:
            self._battery_ns = receive_time_ns
            self._requests.add(framing.BATTERY, b"\x95")
        events += self._requests.passed(receive_time_ns)
        return events + self._assembly.events()

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples that the decoder still holds back."""
        return self._assembly.finish()

    def to_send(self) -> bytes:
        """Return the bytes of the next command to the device, each command once; b"" if there is none."""
        return self._requests.command()

    def _begin(self) -> None:
        requests = self._requests
        requests.clear()
        if not self._asks:
            return
        requests.add(_STOP, b"\x20")
        requests.add(_CRC, b"\x8b\x02")  # firmware without CRC ignores both bytes
        requests.add(framing.VERSION, b"\x3f")
        requests.add(framing.FIRMWARE, b"\x2e")
        if self._ticks:
            requests.add("sensors", b"\x08" + _SENSORS)
            requests.add("rate", b"\x05" + self._ticks.to_bytes(2, "little"))
        requests.add(framing.GYRO_RANGE, b"\x4b")
        requests.add(framing.CALIBRATION, b"\x2c")
        requests.add(framing.INQUIRY, b"\x01")
        requests.add(_START, b"\x07")

    def _awaits_ack(self) -> bool:
        """Return whether the open request is answered by an acknowledgement alone; that of the CRC carries one."""
        key = self._requests.key
        return isinstance(key, str) and (key != _CRC or self._frames.checked)

    def _unanswered(self) -> list[Notice]:
        """Handle an unanswered request: skip that of battery, or of CRC over a serial port; else start all anew."""
        key = self._requests.key
        if key == framing.BATTERY or (key == _CRC and not self._needs_crc):
            self._requests.answered()
            return []
        self._begin()
        return [Notice("settings", Code.REQUEST_UNANSWERED(request=f"{key}"))]

    def _took(self, frame: Frame, receive_time_ns: int) -> list[Event]:
        key = self._requests.key
        if frame.kind == framing.DATA:
            if key == _START and not self._requests.sending:
                self._requests.answered()
            return self._measured(frame.data, receive_time_ns)
        if frame.kind in (framing.ACK, framing.NACK):
            refused = frame.kind == framing.NACK
            if key is None or self._requests.sending or not (refused or self._awaits_ack()):
                return []
            self._requests.answered()
            return [Notice("settings", Code.REQUEST_REFUSED(request=f"{key}", error="FE"))] if refused else []
        if key == frame.kind:
            self._requests.answered()
        events = self._answered(frame)
        self._assembly.about = self._about()
        return events

    def _answered(self, frame: Frame) -> list[Event]:
        data = frame.data
        match frame.kind:
            case framing.VERSION if data[0] != _SHIMMER3:
                self._requests.clear()
                return [Notice("model", Code.NOT_SHIMMER3(version=f"{data[0]}"))]
            case framing.FIRMWARE:
                self._firmware = f"{int.from_bytes(data[2:4], 'little')}.{data[4]}.{data[5]}"
            case framing.GYRO_RANGE:
                self._range = min(data[0], len(RANGES_DPS) - 1)
            case framing.CALIBRATION:
                return self._calibrated(data)
            case framing.INQUIRY:
                return self._inquired(data)
            case framing.BATTERY:
                return [battery(data)]
        return []

    def _calibrated(self, data: bytes) -> list[Event]:
        for channels, place in _BLOCKS.items():
            block = data[place * BYTES :][:BYTES]
            self._calibrations[channels] = Calibration.stored(block, gyro=channels == GYRO)
        stored = self._calibrations[GYRO] is not None
        if not stored:
            self._calibrations[GYRO] = Calibration.nominal(self._range)
        return [Notice("calibration", None if stored else Code.GYRO_NOT_CALIBRATED())]

    def _inquired(self, data: bytes) -> list[Event]:
        """Read the layout of the data packets from the inquiry's answer."""
        self._frames.packet, self._gyro, self._accel = 0, None, None
        channels = data[8:]
        ticks = int.from_bytes(data[:2], "little")
        if not ticks or any(channel not in _WIDTHS for channel in channels):
            self.faults.add(UNKNOWN_CHANNEL)
            return []
        places: dict[int, int] = {}
        at = _TIME_BYTES
        for channel in channels:
            places[channel] = at
            at += _WIDTHS[channel]
        self._frames.packet, self._frames.period = 1 + at, ticks
        self._rate_hz = TICKS_A_S / ticks
        self._gyro = _reading(places, GYRO, "big")
        for accel in (_LOW_NOISE, _WIDE_RANGE):
            reading, calibration = _reading(places, accel, "little"), self._calibrations.get(accel)
            if reading is not None and calibration is not None and self._accel is None:
                self._accel = reading, calibration
        return [Notice(OUTPUT, Code.NO_RATE_OF_TURN() if self._gyro is None else None)]

    def _measured(self, data: bytes, receive_time_ns: int) -> list[Event]:
        self._heard_ns = receive_time_ns
        calibration = self._calibrations.get(GYRO)
        if self._gyro is None or calibration is None or self._requests.key not in (None, framing.BATTERY):
            self.faults.add(UNSETTLED)
            return []
        counts = self._gyro(data)
        sped: Vector | None = None
        if self._accel is not None:
            read, accel = self._accel
            sped = accel.of(read(data))
        self._assembly.add(
            int.from_bytes(data[:_TIME_BYTES], "little"),
            calibration.of(counts),
            sped,
            receive_time_ns=receive_time_ns,
            clipped=max(counts) == _LARGEST or min(counts) == -_LARGEST - 1,
        )
        return []

    def _about(self) -> DeviceDescription:
        return DeviceDescription("Shimmer3", self._firmware, radians(RANGES_DPS[self._range]), self._rate_hz)


def _reading(places: dict[int, int], channels: tuple[int, int, int], order: str) -> Reading | None:
    """Reader of three signed 16-bit channels of a packet, or None if one is missing."""
    if not places.keys() >= {*channels}:
        return None
    x, y, z = (places[channel] for channel in channels)

    def read(data: bytes) -> tuple[int, int, int]:
        return _signed(data, x, order), _signed(data, y, order), _signed(data, z, order)

    return read


def _signed(data: bytes, at: int, order: str) -> int:
    return int.from_bytes(data[at : at + 2], "big" if order == "big" else "little", signed=True)


KIND = stream_kind(
    "shimmer3",
    "Shimmer3, Bluetooth (serial or Low Energy): port, rate_hz",
    Shimmer3Options,
    Shimmer3Decoder,
)
