"""Finds the channels of gyro, accelerometer and thermometer in the metadata of a Lab Streaming Layer (LSL) stream."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.sample_assembly import Vector
from bridge.recording.text.names import understood
from bridge.text.units import ACCEL, GYRO, unit_in

if TYPE_CHECKING:
    import pylsl

Row = NDArray[np.floating]


class NoChannels(LookupError):
    """Error: an LSL stream lacks the needed channels. The message lists the missing labels, or is `gyro`."""


class NoUnit(LookupError):
    """Error: the unit of LSL channels is missing or unknown. option: the driver option that can state the unit."""

    def __init__(self, channels: str, unit: str, option: str) -> None:
        super().__init__(channels)
        self.channels, self.unit, self.option = channels, unit, option


class Triple(NamedTuple):
    """Channel indices of a sensor's x, y and z axes (`at`), and the factor from channel values to rad/s or m/s²."""

    at: tuple[int, int, int]
    factor: float

    def vector(self, row: Row) -> Vector:
        """Return the sensor's vector (x, y, z) of one sample, in rad/s or m/s². row: values of all channels of the sample."""
        x, y, z = self.at
        return float(row[x]) * self.factor, float(row[y]) * self.factor, float(row[z]) * self.factor


class Channels(NamedTuple):
    """Channels of an LSL stream to read: gyro, accelerometer, and the index of the temperature channel (°C).

    accel, temperature: None if the stream has none.
    """

    gyro: Triple
    accel: Triple | None
    temperature: int | None


class _Channel(NamedTuple):
    label: str
    unit: str
    kind: str
    axis: str


def find(
    about: "pylsl.StreamInfo", gyro: Sequence[str], accel: Sequence[str], gyro_unit: str, accel_unit: str
) -> Channels:
    """Find the gyro, accelerometer and temperature channels in a stream's metadata.

    about: the metadata. gyro, accel: labels of the x, y, z channels; if empty, channels are found by label, type and
    unit. gyro_unit, accel_unit: replace the unit in the metadata, unless "".
    Raises NoChannels if gyro channels or given labels are missing, and NoUnit if a unit is missing or unknown.
    """
    channels = _channels(about)
    rates = _axes(channels, "gyro", gyro)
    if rates is None:
        raise NoChannels("gyro")
    forces = _axes(channels, "accel", accel)
    temperature = next((at for at, one in enumerate(channels) if one.kind == "temperature"), None)
    return Channels(
        _triple(channels, rates, GYRO, gyro_unit, "gyro_unit"),
        None if forces is None else _triple(channels, forces, ACCEL, accel_unit, "accel_unit"),
        temperature,
    )


def _channels(about: "pylsl.StreamInfo") -> list[_Channel]:
    found, channel = list[_Channel](), about.desc().child("channels").child("channel")
    of_stream = {"gyr": "gyro", "acc": "accel"}.get(about.type()[:3].lower(), "")
    while not channel.empty() and len(found) < about.channel_count():
        label, kind, unit = (channel.child_value(name) for name in ("label", "type", "unit"))
        by_label, by_type = understood(label), understood(kind)
        name = by_label if by_label.kind not in {"", "axis"} or not by_type.kind else by_type
        stated = unit or by_label.unit
        meant = name.kind
        if meant == "axis":  # x, y, z alone: the unit or the stream's type tells the quantity
            meant = "gyro" if unit_in(stated, GYRO) else "accel" if unit_in(stated, ACCEL) else of_stream
        found.append(_Channel(label, stated, meant, name.axis))
        channel = channel.next_sibling("channel")
    return found


def _axes(channels: Sequence[_Channel], kind: str, labels: Sequence[str]) -> tuple[int, int, int] | None:
    """Indices of the x, y, z channels; None if an axis is missing. Raises NoChannels for unknown labels."""
    if labels:
        known = {one.label: at for at, one in reversed(list(enumerate(channels)))}
        if missing := [label for label in labels if label not in known]:
            raise NoChannels(", ".join(missing))
        x, y, z = (known[label] for label in labels)
        return x, y, z
    at = {one.axis: n for n, one in reversed(list(enumerate(channels))) if one.kind == kind}
    return (at["x"], at["y"], at["z"]) if {"x", "y", "z"} <= at.keys() else None


def _triple(
    channels: Sequence[_Channel], at: tuple[int, int, int], known: dict[str, float], given: str, option: str
) -> Triple:
    """Channels with their unit: the given one, else the one that all three state. Raises NoUnit."""
    stated = {channels[n].unit for n in at}
    unit = given or (stated.pop() if len(stated) == 1 else "")
    factor = unit_in(unit, known)
    if factor is None:
        raise NoUnit(", ".join(channels[n].label for n in at), unit, option)
    return Triple(at, factor)
