"""Driver for Movella (Xsens) DOT sensors, over Bluetooth Low Energy.

The sensor measures only on command. The driver sets the output data rate, and starts the measurement with a payload
that contains angular rates. After 3 s without samples, it starts the measurement again.
Source: Movella DOT BLE Service Specification, XD0506P.
"""

import struct
from math import radians
from typing import Final, NamedTuple

from bridge.drivers.byte_stream import StreamDriver, StreamOptions
from bridge.drivers.driver import Battery, DriverKind, Event, Notice
from bridge.drivers.request_queue import RequestQueue
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler, Vector
from bridge.framing import gatt_values
from bridge.framing.gatt_values import GattValues
from bridge.reasons.codes import Code
from bridge.toml.loader import nearest
from bridge.transport import address, ble_port
from bridge.transport.ble_gatt import Codec, GattPort
from bridge.wire.refusal import Tally

EXAMPLE: Final = "ble://D4:22:CD:00:12:34"
RATES_HZ: Final = (1, 4, 10, 12, 15, 20, 30, 60)
INFO, DEVICE_CONTROL, CONTROL, LONG, MEDIUM, BATTERY = 0x1001, 0x1002, 0x2001, 0x2002, 0x2003, 0x3001
BAD_VALUE, FOREIGN, UNSETTLED = "value_odd", "value_of_another_mode", "samples_before_settled"
_TICK_S, _TICK_BITS = 1e-6, 32
_GYRO_RANGE = radians(2000.0)
_AGAIN_S, _TIMES = 2.0, 5
_SILENT_NS = 3_000_000_000
_STOP, _START = 0, 1
_RATE_ONLY = 1 << 4  # bit of the device control that makes only the output rate count
_TICK, _THREE = struct.Struct("<I"), struct.Struct("<3f")
_INFO_BYTES, _CONTROL_BYTES = 34, 32
_CODEC = Codec(gatt_values.encode, gatt_values.decode)


class Payload(NamedTuple):
    """Payload format of a Movella DOT in which angular rates are sent.

    mode: number of the measurement mode. characteristic: number of the BLE characteristic that sends the payload.
    gyro, accel: byte offsets of the angular rate (3 float32: x, y, z, °/s) and of the acceleration (3 float32: x, y, z,
    m/s²); all are little-endian. accel is None if the payload has no acceleration that can be used.
    """

    mode: int
    characteristic: int
    gyro: int
    accel: int | None = None


PAYLOADS: Final = {
    "rate_quantities": Payload(21, MEDIUM, 16, 4),
    "rate_quantities_mag": Payload(20, MEDIUM, 16, 4),
    "custom_1": Payload(22, MEDIUM, 28),  # its acceleration is in the earth frame, without gravity
    "custom_3": Payload(24, MEDIUM, 20),
    "custom_5": Payload(26, LONG, 32, 20),
}
_NOT_READ: Final = {
    "custom_2": "the payload carries no angular velocity",
    "custom_4": "only the vendor's own software can decode it",
    "high_fidelity": "only the vendor's own software can decode it",
}


class MovellaDotOptions(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a Movella DOT sensor: Bluetooth address, output data rate in Hz, and payload.

    Raises ValueError for an invalid option.
    """

    #: Bluetooth address of the sensor, for example `ble://D4:22:CD:00:12:34`
    port: str
    #: output data rate to set in the sensor, Hz: 1, 4, 10, 12, 15, 20, 30 or 60; 0 leaves the sensor's rate
    rate_hz: int = 0
    #: payload to measure: `rate_quantities`, `rate_quantities_mag`, `custom_1`, `custom_3` or `custom_5`; the first has
    #: all that truerate uses, and `custom_1` and `custom_3` lack acceleration
    payload: str = "rate_quantities"

    def __post_init__(self) -> None:
        if self.payload in _NOT_READ:
            raise ValueError(f"payload {self.payload!r} cannot be read: {_NOT_READ[self.payload]}; use rate_quantities")
        if self.payload not in PAYLOADS:
            raise ValueError(f"unknown payload {self.payload!r}; {nearest(self.payload, PAYLOADS)}")
        if self.rate_hz and self.rate_hz not in RATES_HZ:
            raise ValueError(f"rate_hz is {self.rate_hz}: use one of {', '.join(map(str, RATES_HZ))}")
        if self.port.startswith("ble://"):
            _gatt(self)
        elif self.port.startswith("/dev/"):
            raise ValueError(f"port {self.port!r}: a DOT has only Bluetooth; write a port such as {EXAMPLE!r}")
        else:
            address.check(self.port, self.baud)


class MovellaDotDecoder:
    """Decoder of a Movella DOT's values, which arrive in frames of `bridge.framing.gatt_values`.

    The decoder also sends the commands that set the output data rate and start the measurement. Without options, and
    if the port is a file, it sends nothing.
    """

    def __init__(self, options: MovellaDotOptions | None = None) -> None:
        self.faults = Tally()
        self._rate_hz = 0 if options is None else options.rate_hz
        self._payload = PAYLOADS["rate_quantities" if options is None else options.payload]
        self._asks = options is not None and not options.port.startswith("file://")
        self._requests = RequestQueue(_AGAIN_S, _TIMES, self._unanswered)
        self._product, self._firmware = "Movella DOT", ""
        self._assembly = SampleAssembler(self.faults, self._about(), _TICK_S, _TICK_BITS)
        self.opened()

    def opened(self) -> None:
        """Reset the decoder for a newly opened connection, and queue the commands that start the measurement."""
        self._values = GattValues(self.faults)
        self._assembly.opened()
        self._heard_ns = 0
        self._begin()

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        After 3 s without samples, the commands that start the measurement are queued again.
        """
        events: list[Event] = []
        for characteristic, value in self._values.feed(data):
            events += self._took(characteristic, value, receive_time_ns)
        if self._heard_ns and receive_time_ns - self._heard_ns > _SILENT_NS:
            self._heard_ns = 0
            self._begin()
        events += self._requests.passed(receive_time_ns)
        return events + self._assembly.events()

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples that the decoder still holds back."""
        return self._assembly.finish()

    def to_send(self) -> bytes:
        """Return the bytes of the next command to the device, each command once; b"" if there is none."""
        return self._requests.command()

    def _begin(self) -> None:
        self._requests.clear()
        if not self._asks:
            return
        self._requests.add("device info", gatt_values.encode(INFO))
        self._requests.add("battery", gatt_values.encode(BATTERY))
        mode = self._payload.mode
        stop, start = (gatt_values.encode(CONTROL, bytes((1, action, mode))) for action in (_STOP, _START))
        rate = self._rate_hz.to_bytes(2, "little")
        control = (bytes((_RATE_ONLY,)) + bytes(23) + rate).ljust(_CONTROL_BYTES, b"\0")
        setting = [gatt_values.encode(DEVICE_CONTROL, control)] if self._rate_hz else []
        self._requests.add("start", stop, *setting, start)

    def _unanswered(self) -> list[Notice]:
        unanswered = Notice("settings", Code.REQUEST_UNANSWERED(request=f"{self._requests.key}"))
        self._begin()
        return [unanswered]

    def _answered(self, key: str) -> None:
        if self._requests.key == key and not self._requests.sending:
            self._requests.answered()

    def _took(self, characteristic: int, value: bytes, receive_time_ns: int) -> list[Event]:
        if characteristic == self._payload.characteristic:
            return self._measured(value, receive_time_ns)
        if characteristic == INFO and len(value) == _INFO_BYTES:
            self._firmware = ".".join(map(str, value[6:9]))
            code = "".join(c for c in value[28:].decode("ascii", "ignore") if c.isprintable())
            self._product = f"Movella DOT {code}".strip()
            self._assembly.about = self._about()
            self._answered("device info")
        elif characteristic == BATTERY and len(value) == 2 and value[0] <= 100:
            self._answered("battery")
            return [Battery(float(value[0]), charging=value[1] == 1)]
        else:
            self.faults.add(FOREIGN if characteristic in (LONG, MEDIUM) else BAD_VALUE)
        return []

    def _measured(self, value: bytes, receive_time_ns: int) -> list[Event]:
        """Decode a payload; the sensor may fill it up with zeros."""
        accel = self._payload.accel
        if len(value) < self._payload.gyro + _THREE.size:
            self.faults.add(BAD_VALUE)
            return []
        if self._requests.key not in (None, "start") or self._requests.sending:
            self.faults.add(UNSETTLED)  # perhaps of another mode
            return []
        self._heard_ns = receive_time_ns
        self._answered("start")
        x, y, z = _THREE.unpack_from(value, self._payload.gyro)
        sped: Vector | None = None if accel is None else _THREE.unpack_from(value, accel)
        [tick] = _TICK.unpack_from(value)
        self._assembly.add(tick, (radians(x), radians(y), radians(z)), sped, receive_time_ns=receive_time_ns)
        return []

    def _about(self) -> DeviceDescription:
        return DeviceDescription(self._product, self._firmware, _GYRO_RANGE, self._rate_hz, divided_hz=max(RATES_HZ))


def _uuid(number: int) -> str:
    return f"1517{number:04x}-4947-11e9-8646-d663bd873d93"


def _gatt(options: MovellaDotOptions) -> GattPort:
    return GattPort(options.port, EXAMPLE, _uuid, (PAYLOADS[options.payload].characteristic, BATTERY), _CODEC)


def _make(options: MovellaDotOptions) -> StreamDriver:
    return StreamDriver(
        options, MovellaDotDecoder(options), _gatt(options) if options.port.startswith("ble://") else None
    )


KIND = DriverKind(
    name="movella_dot",
    summary="Movella (Xsens) DOT, Bluetooth: port, rate_hz, payload",
    options=MovellaDotOptions,
    make=_make,
    state=lambda options: ble_port.reach() if options.port.startswith("ble://") else address.state(options.port),
    decoder=MovellaDotDecoder,
)
