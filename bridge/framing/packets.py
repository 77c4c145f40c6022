"""Packets of truerate's own serial protocol, little-endian, one packet per COBS frame.

    HELLO     01 version boot tick_period_s rate_hz gyro_range has model 00 firmware    device -> host
    DATA      02 n boot sequence (ticks gyro[3] accel[3] temperature)[n]                device -> host
    OWN       03 boot sequence k[3] bias[3]                                             device -> host
    BATTERY   04 percent charging                                                       device -> host
    IDENTIFY  81                                                                        host -> device: send HELLO
    RATE      82 rate_hz                                                                host -> device: set this rate

The first byte of a packet is its kind, in hexadecimal. version, n, has and charging are uint8, sequence and ticks
uint32, and boot uint64. rate_hz, tick_period_s and the gyro_range of HELLO are float64; all other numbers are float32.
model and firmware are ASCII texts of at most 64 bytes each, with a zero byte between them.

A device sends HELLO at boot, once a second and when asked. `boot` is a random number drawn at power-up. `sequence`
counts samples since the boot. `ticks` is the device's clock (32 bits, wraps), in ticks of tick_period_s seconds.
rate_hz is the output data rate in Hz; gyro_range is the full-scale range in rad/s.
DATA has n samples, the first with the number `sequence`; gyro is in rad/s, accel in m/s² and temperature in °C. The
bits of `has` tell if the device measures acceleration (1) and temperature (2).
OWN is a calibration that the device made itself in this boot, from samples up to `sequence`: rate = k (gyro - bias),
with k without unit and bias in rad/s. A device that has one sends it with each HELLO.
BATTERY is the charge, 0 to 100 %, and 1 if the battery is charging, else 0. A device sends it with HELLO, or
when it changes.
A device may ignore RATE. A device that obeys sends HELLO with its new rate, which lasts until power-off.
"""

import struct
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import DeviceCalibration

VERSION = 1
HELLO, DATA, OWN, BATTERY, IDENTIFY, RATE = 0x01, 0x02, 0x03, 0x04, 0x81, 0x82
HAS_ACCEL, HAS_TEMPERATURE = 1, 2
MAX_SAMPLES = 24  # keeps a DATA packet well under the frame limit

_HELLO = struct.Struct("<BBQdddB")
_DATA = struct.Struct("<BBQI")
_OWN = struct.Struct("<BQI6f")
_BATTERY = struct.Struct("<BfB")
_RATE = struct.Struct("<Bd")
_SAMPLE = np.dtype([("ticks", "<u4"), ("gyro", "<f4", 3), ("accel", "<f4", 3), ("temperature_c", "<f4")])


class BadPacket(Exception):
    """Error: a packet with an intact frame has invalid content. label: name of the fault, for counting."""

    def __init__(self, label: str) -> None:
        super().__init__(label)
        self.label = label


@dataclass(frozen=True, slots=True)
class Hello:
    """Content of a HELLO packet: a device's identity and boot number.

    tick_period_s: seconds per tick of its clock. rate_hz: output data rate. gyro_range: full-scale range in rad/s, 0 if
    unknown. has_accel, has_temperature: True if the device measures them.
    """

    boot: int
    tick_period_s: float
    rate_hz: float
    gyro_range: float
    has_accel: bool
    has_temperature: bool
    model: str
    firmware: str


class Data(NamedTuple):
    """Content of a DATA packet: n consecutive samples, in the sensor frame.

    sequence: number of the first sample since boot, 32 bits. ticks (n,) uint32: device time in ticks.
    gyro (n, 3): rad/s. accel (n, 3): m/s². temperature_c (n,): °C. All three are float32.
    """

    boot: int
    sequence: int
    ticks: NDArray[np.uint32]
    gyro: NDArray[np.float32]
    accel: NDArray[np.float32]
    temperature_c: NDArray[np.float32]


class Charge(NamedTuple):
    """Content of a BATTERY packet. percent: charge, 0 to 100 %. charging: True if the battery is being charged."""

    percent: float
    charging: bool


def encode_hello(hello: Hello) -> bytes:
    """Encode the payload of a HELLO packet (identity of a device)."""
    has = HAS_ACCEL * hello.has_accel | HAS_TEMPERATURE * hello.has_temperature
    head = _HELLO.pack(HELLO, VERSION, hello.boot, hello.tick_period_s, hello.rate_hz, hello.gyro_range, has)
    return head + hello.model.encode() + b"\0" + hello.firmware.encode()


def encode_data(data: Data) -> bytes:
    """Encode the payload of a DATA packet (samples). Raises ValueError unless there are 1 to MAX_SAMPLES samples."""
    n = len(data.ticks)
    if not 1 <= n <= MAX_SAMPLES:
        raise ValueError(f"the DATA packet has {n} samples: give 1 to {MAX_SAMPLES}")
    samples = np.empty(n, _SAMPLE)
    for name in ("ticks", "gyro", "accel", "temperature_c"):
        samples[name] = getattr(data, name)
    return _DATA.pack(DATA, n, data.boot, data.sequence & 0xFFFFFFFF) + samples.tobytes()


def encode_own(own: DeviceCalibration) -> bytes:
    """Encode the payload of an OWN packet (calibration that the device made itself)."""
    return _OWN.pack(OWN, own.boot, own.sequence, *own.scale, *own.bias)


def encode_battery(charge: Charge) -> bytes:
    """Encode the payload of a BATTERY packet (charge of the battery)."""
    return _BATTERY.pack(BATTERY, charge.percent, charge.charging)


def encode_identify() -> bytes:
    """Encode the payload of an IDENTIFY packet, which asks a device for its HELLO."""
    return bytes([IDENTIFY])


def encode_rate(rate_hz: float) -> bytes:
    """Encode the payload of a RATE packet, which sets a device's output data rate in Hz."""
    return _RATE.pack(RATE, rate_hz)


def decode_rate(payload: bytes) -> float | None:
    """Return the output data rate in Hz in a payload to the device.

    None if the payload is not a RATE packet, or if the rate is not within 0.1 to 100000 Hz.
    """
    if payload[0] != RATE or len(payload) != _RATE.size:
        return None
    _, rate_hz = _RATE.unpack(payload)
    return float(rate_hz) if 0.1 <= rate_hz <= 100_000 else None


def decode(payload: bytes) -> Hello | Data | DeviceCalibration | Charge:
    """Decode the payload of a packet from a device: HELLO, DATA, OWN or BATTERY.

    Raises BadPacket, with the label to count, for any other or invalid packet.
    """
    if payload[0] == HELLO:
        return _decode_hello(payload)
    if payload[0] == DATA:
        return _decode_data(payload)
    if payload[0] == OWN:
        return _decode_own(payload)
    if payload[0] == BATTERY:
        return _decode_battery(payload)
    raise BadPacket("packet_unknown_kind")


def _decode_hello(payload: bytes) -> Hello:
    if len(payload) < _HELLO.size:
        raise BadPacket("packet_length")
    _, version, boot, tick_period_s, rate_hz, gyro_range, has = _HELLO.unpack_from(payload)
    if version != VERSION:
        raise BadPacket("packet_version")
    sane = 1e-9 <= tick_period_s <= 1 and 0.1 <= rate_hz <= 100_000 and 0 <= gyro_range <= 1000
    model, mark, firmware = payload[_HELLO.size :].partition(b"\0")
    if not (sane and mark and len(model) <= 64 and len(firmware) <= 64):
        raise BadPacket("packet_content")
    names = [raw.decode("ascii", "replace") for raw in (model, firmware)]
    if not all(name.isprintable() for name in names):
        raise BadPacket("packet_content")
    return Hello(boot, tick_period_s, rate_hz, gyro_range, bool(has & HAS_ACCEL), bool(has & HAS_TEMPERATURE), *names)


def _decode_data(payload: bytes) -> Data:
    if len(payload) < _DATA.size:
        raise BadPacket("packet_length")
    _, n, boot, sequence = _DATA.unpack_from(payload)
    if not 1 <= n <= MAX_SAMPLES or len(payload) != _DATA.size + n * _SAMPLE.itemsize:
        raise BadPacket("packet_length")
    samples = np.frombuffer(payload, _SAMPLE, n, _DATA.size)
    return Data(boot, sequence, samples["ticks"], samples["gyro"], samples["accel"], samples["temperature_c"])


def _decode_battery(payload: bytes) -> Charge:
    if len(payload) != _BATTERY.size:
        raise BadPacket("packet_length")
    _, percent, charging = _BATTERY.unpack(payload)
    if not (0 <= percent <= 100 and charging in (0, 1)):
        raise BadPacket("packet_content")
    return Charge(percent, bool(charging))


def _decode_own(payload: bytes) -> DeviceCalibration:
    if len(payload) != _OWN.size:
        raise BadPacket("packet_length")
    _, boot, sequence, *values = _OWN.unpack(payload)
    scale, bias = tuple(values[:3]), tuple(values[3:])
    if not (all(abs(k) <= 10 for k in scale) and all(abs(b) <= 1000 for b in bias)):  # neither is NaN
        raise BadPacket("packet_content")
    return DeviceCalibration(boot, sequence, scale, bias)
