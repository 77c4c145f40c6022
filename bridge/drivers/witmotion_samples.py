"""Combines WitMotion frames to samples: each measuring cycle sends time, acceleration, rate and more, one frame each."""

import struct
from datetime import datetime, timedelta
from math import radians
from typing import NamedTuple

from bridge.drivers.sample_assembly import Vector
from bridge.framing import witmotion
from bridge.framing.witmotion import Frame
from bridge.wire.refusal import Tally

HALF, BAD_TIME = "half_missing", "bad_time"
GYRO_RANGE = radians(2000.0)
_GYRO = GYRO_RANGE / 32768
_ACCEL = 16 * 9.80665 / 32768
_ANGLES_END = 18  # bytes; date and time follow on devices that send them
_WITHOUT_ACCEL = 8  # consecutive rates, after which acceleration counts as not sent
_EPOCH = datetime(1999, 12, 31)  # noqa: DTZ001 - the device has no time zone
_FOUR, _SIX = struct.Struct("<4h"), struct.Struct("<6h")


class Sample(NamedTuple):
    """One sample of a WitMotion device: gyro (x, y, z) in rad/s; accel (x, y, z) in m/s², or None.

    time_ms: device time, ms since 1999-12-31 by the device's calendar; None if not sent.
    accel_word, gyro_word: fourth word of the acceleration and rate frames, in 0.01 °C if it is a temperature.
    """

    time_ms: int | None
    gyro: Vector
    accel: Vector | None
    accel_word: int | None = None
    gyro_word: int | None = None


class Cycles:
    """Combines WitMotion frames to samples: time, acceleration and rate of one measuring cycle become one sample.

    A rate or acceleration frame without its counterpart is dropped and counted in `faults`. After eight rates in a row
    without acceleration, samples have only rates.
    """

    def __init__(self, faults: Tally) -> None:
        self.faults = faults
        self.opened()

    def opened(self) -> None:
        """Drop an unfinished cycle, because the port was opened (again)."""
        self._last_kind = 0
        self._time_ms: int | None = None
        self._accel: tuple[int, ...] | None = None
        self._alone = 0

    def take(self, frame: Frame) -> Sample | None:
        """Add a received frame; return the sample that it completes, or None."""
        if frame.kind == witmotion.MOTION:
            x, y, z, *gyro = _SIX.unpack_from(frame.data)
            time_ms = self._time(frame.data[_ANGLES_END:]) if len(frame.data) > _ANGLES_END else None
            return Sample(time_ms, _vector(gyro, _GYRO), _vector((x, y, z), _ACCEL))
        if frame.kind >= witmotion.REGISTERS:
            return None
        if frame.after_fault or frame.kind <= self._last_kind:
            self._drop()
        self._last_kind = frame.kind
        if frame.kind == witmotion.TIME:
            self._time_ms = self._time(frame.data)
        elif frame.kind == witmotion.ACCEL:
            self._accel, self._alone = _FOUR.unpack(frame.data), 0
        elif frame.kind == witmotion.GYRO:
            return self._complete(_FOUR.unpack(frame.data))
        return None

    def _complete(self, gyro: tuple[int, ...]) -> Sample | None:
        time_ms, accel = self._time_ms, self._accel
        self._time_ms = self._accel = None
        if accel is not None:
            return Sample(time_ms, _vector(gyro, _GYRO), _vector(accel, _ACCEL), accel[3], gyro[3])
        self._alone = min(self._alone + 1, _WITHOUT_ACCEL)
        if self._alone < _WITHOUT_ACCEL:
            self.faults.add(HALF)
            return None
        return Sample(time_ms, _vector(gyro, _GYRO), None, None, gyro[3])

    def _drop(self) -> None:
        if self._accel is not None:
            self.faults.add(HALF)
        self._time_ms = self._accel = None

    def _time(self, data: bytes) -> int | None:
        """Time of the device's calendar in ms; an unset calendar has month 0 and day 0."""
        year, month, day, hour, minute, second = data[:6]
        ms = int.from_bytes(data[6:], "little")
        try:
            of_month = datetime(2000 + year, max(month, 1), max(day, 1), hour, minute, second)  # noqa: DTZ001
        except ValueError:
            self.faults.add(BAD_TIME)
            return None
        at = of_month if day else of_month - timedelta(days=1)  # day 0 is the day before day 1
        return round((at - _EPOCH).total_seconds()) * 1000 + ms


def _vector(raw: tuple[int, ...] | list[int], unit: float) -> Vector:
    return raw[0] * unit, raw[1] * unit, raw[2] * unit
