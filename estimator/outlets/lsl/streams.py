"""LSL streams of a device, and of its ward's markers, with metadata as specified by XDF.

See https://github.com/sccn/xdf/wiki/Meta-Data. Quaternions follow its type MoCap: scalar first, OrientationA to D.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
import pylsl
from numpy.typing import NDArray
from pylsl.info import XMLElement

from bridge.wire.messages import CorrectedBatch, DeviceInfo, OrientationBatch, Quality, SampleBatch, Status

Batch = CorrectedBatch | OrientationBatch | SampleBatch
Columns = NDArray[np.floating]

_AXES: Final = ("x", "y", "z")
#: highest nominal rate, Hz: liblsl reserves memory for five seconds of it. A higher rate is irregular, which reserves little
_MAX_HZ: Final = 10_000.0
_MANUFACTURERS: Final = {"ximu3": "x-io Technologies", "witmotion": "WitMotion", "mtdata2": "Xsens"}
#: of an x-IMU3, whose driver appends it to the model
_SERIAL: Final = re.compile(r" ([0-9A-F]{4}(?:-?[0-9A-F]{4}){1,3})$")


class Channel(NamedTuple):
    """Label, unit and type of one channel of an LSL stream, as in its XDF metadata."""

    label: str
    unit: str
    type: str


def _vector(label: str, unit: str, kind: str) -> list[Channel]:
    return [Channel(f"{label}_{axis}", unit, f"{kind}{axis.upper()}") for axis in _AXES]


def channels_of(kind: str, info: DeviceInfo) -> list[Channel]:
    """Return the channels of a stream of this kind, each with label, unit and type.

    kind: rates (rad/s), orientation (unit quaternion), quality (grade, flags, sequence number, rate_std in rad/s) or
    raw (rad/s, m/s², °C). The channels of `raw` depend on the device's sensors.
    """
    if kind == "rates":
        return _vector("gyro", "rad/s", "AngularVelocity")
    if kind == "orientation":
        return [
            Channel(f"quat_{part}", "none", f"Orientation{letter}") for part, letter in zip("wxyz", "ABCD", strict=True)
        ]
    if kind == "quality":
        std = _vector("gyro_std", "rad/s", "Confidence")
        return [
            Channel("quality", "none", "Confidence"),
            Channel("flags", "none", "Flags"),
            Channel("sequence", "none", "Count"),
            *std,
        ]
    return [
        *_vector("gyro", "rad/s", "AngularVelocity"),
        *(_vector("accel", "m/s2", "Acceleration") if info.has_accel else []),
        *([Channel("temperature", "celsius", "Temperature")] if info.has_temperature else []),
    ]


def values_of(kind: str, batch: Batch, info: DeviceInfo) -> Columns:
    """Return the values (n, channels) of a batch for a stream of this kind, in the units of `channels_of`.

    NaN where the batch lacks a column.
    """
    if isinstance(batch, OrientationBatch):
        return batch.quat_wxyz
    if isinstance(batch, CorrectedBatch):
        if kind == "rates":
            return batch.rate
        n = len(batch)
        numbers = np.column_stack([np.full(n, batch.quality), batch.flags, batch.sequence + np.arange(n)])
        return np.hstack([numbers, batch.rate_std])
    parts = [batch.gyro]
    if info.has_accel:
        parts.append(np.full((len(batch), 3), np.nan, np.float32) if batch.accel is None else batch.accel)
    if info.has_temperature:
        celsius = np.full(len(batch), np.nan, np.float32) if batch.temperature_c is None else batch.temperature_c
        parts.append(celsius[:, None])
    return np.hstack(parts)


class DeviceStream:
    """LSL stream of one kind from one device; sends each sample once, in order.

    kind: as in `channels_of`. ward: id. info, status: of the device, for the stream's metadata.
    """

    def __init__(self, ward: str, kind: str, info: DeviceInfo, status: Status) -> None:
        self._kind, self._info = kind, info
        self._boot, self._next = 0, 0
        channels = channels_of(kind, info)
        made = pylsl.StreamInfo(
            f"{info.device} {kind}",
            {"orientation": "MoCap", "quality": "Quality"}.get(kind, "IMU"),
            len(channels),
            info.rate_hz if info.rate_hz <= _MAX_HZ else pylsl.IRREGULAR_RATE,
            pylsl.cf_double64 if kind == "quality" else pylsl.cf_float32,
            f"truerate/{ward}/{info.device}/{kind}",
        )
        _describe(made.desc(), channels, ward, info, status)
        self._outlet = pylsl.StreamOutlet(made)

    def push(self, batch: Batch, stamps: NDArray[np.float64]) -> None:
        """Send the samples of a batch that were not sent before. stamps (n,): LSL times of the samples, s."""
        if batch.boot != self._boot:
            self._boot, self._next = batch.boot, 0
        skip = max(0, self._next - batch.sequence)
        if skip < len(batch):
            self._next = batch.sequence + len(batch)
            self._outlet.push_chunk(values_of(self._kind, batch, self._info)[skip:], stamps[skip:].tolist())


class MarkerStream:
    """LSL stream of a ward's markers: one text channel at irregular times."""

    def __init__(self, ward: str) -> None:
        made = pylsl.StreamInfo(
            f"{ward} markers", "Markers", 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, f"truerate/{ward}/markers"
        )
        made.set_channel_labels(["event"])
        made.set_channel_types("Marker")
        self._outlet = pylsl.StreamOutlet(made)

    def push(self, words: str, stamp: float) -> None:
        """Send one marker. words: its text. stamp: its LSL time, s."""
        self._outlet.push_sample([words], stamp)


def _describe(root: XMLElement, channels: Sequence[Channel], ward: str, info: DeviceInfo, status: Status) -> None:
    """Write a stream's metadata. They hold for the moment of its creation; markers tell of later calibrations."""
    listed = root.append_child("channels")
    for channel in channels:
        _fill(listed.append_child("channel"), channel._asdict())
    acquisition = {
        "manufacturer": _MANUFACTURERS.get(info.driver, ""),
        "model": info.model,
        "serial_number": serial[0] if (serial := _SERIAL.findall(info.model)) else "",
        "firmware": info.firmware,
        "gyro_range": f"{info.gyro_range:.9g} rad/s" if info.gyro_range else "",
    }
    _fill(root.append_child("acquisition"), acquisition)
    _fill(root.append_child("synchronization"), {"can_drop_samples": "true"})
    _fill(root.append_child("truerate"), {"ward": ward, "device": info.device, "boot": f"{status.boot:016x}"})
    calibration = root.append_child("calibration")
    _fill(calibration, {"id": status.calibration, "quality": Quality(status.quality).name, "unit": "rad/s"})
    for name, vector in (("scale", status.scale), ("bias", status.bias), ("bias_std", status.bias_std)):
        _fill(calibration.append_child(name), {axis: f"{v:.9g}" for axis, v in zip(_AXES, vector, strict=False)})


def _fill(node: XMLElement, values: Mapping[str, str]) -> None:
    for name, value in values.items():
        if value:
            node.append_child_value(name, value)
