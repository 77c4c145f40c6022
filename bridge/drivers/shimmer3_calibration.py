"""Calibration that a Shimmer3 stores for one of its sensors (21 bytes), and the state of its battery."""

import struct
from math import radians
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Battery
from bridge.drivers.sample_assembly import Vector

BYTES: Final = 21
RANGES_DPS: Final = (250, 500, 1000, 2000)
_NOMINAL = (131.0, 65.5, 32.8, 16.4)  # counts for 1 °/s in each range, from the gyro's data sheet
_AXES = np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])  # of the chip in the housing
_BLOCK = struct.Struct(">6h9b")
_GYRO_SCALE, _ALIGNMENT_SCALE = 100, 100
_LEAST = 0.1  # determinant of a plausible alignment
_ADC_V, _DIVIDER = 3 / 4095, 1.988
_EMPTY_V, _FULL_V = 3.2, 4.167
_PERCENT = (1109.739792, -17167.12674, 99232.71686, -253825.397, 242266.0527)  # polynomial of the voltage, by the maker
_CHARGING = 0x80


class Calibration(NamedTuple):
    """Calibration of one sensor of a Shimmer3: value = matrix · (counts − offset), in rad/s or m/s².

    offset (3,): counts. matrix (3, 3): three rows, rad/s or m/s² per count.
    """

    offset: Vector
    matrix: tuple[Vector, Vector, Vector]

    @classmethod
    def stored(cls, block: bytes, *, gyro: bool) -> Self | None:
        """Decode a stored calibration of 21 bytes; None if a sensitivity is not positive, or the alignment nearly singular.

        gyro: True for the gyro, whose sensitivity is per °/s; False for an accelerometer, whose sensitivity is per
        m/s².
        Method: value = R⁻¹ K⁻¹ (counts − b). b (3,) is the offset in counts. K (3, 3) is the diagonal matrix of
        sensitivities in counts per °/s or m/s². R (3, 3) is the alignment matrix, without unit.
        block: b and the diagonal of K as int16, big-endian, then R row by row as int8. R, and K of a gyro, are stored
        in units of 0.01.
        """
        numbers = _BLOCK.unpack(block)
        gains = np.array(numbers[3:6]) / (_GYRO_SCALE if gyro else 1)
        alignment = np.array(numbers[6:]).reshape(3, 3) / _ALIGNMENT_SCALE
        if (gains <= 0).any() or abs(np.linalg.det(alignment)) < _LEAST:
            return None
        return cls._of(numbers[:3], gains, alignment, radians(1) if gyro else 1.0)

    @classmethod
    def nominal(cls, gyro_range: int) -> Self:
        """Return the gyro's calibration according to its data sheet. gyro_range: index into RANGES_DPS."""
        return cls._of((0, 0, 0), np.full(3, _NOMINAL[gyro_range]), _AXES, radians(1))

    @classmethod
    def _of(
        cls,
        offset: tuple[int, ...],
        gains: NDArray[np.float64],
        alignment: NDArray[np.float64],
        unit: float,
    ) -> Self:
        x, y, z = (unit * np.linalg.inv(alignment) @ np.diag(1 / gains)).tolist()
        return cls((offset[0], offset[1], offset[2]), (tuple(x), tuple(y), tuple(z)))

    def of(self, counts: tuple[int, int, int]) -> Vector:
        """Return the calibrated vector (x, y, z), in rad/s or m/s², of a sample's three counts."""
        a, b, c = counts[0] - self.offset[0], counts[1] - self.offset[1], counts[2] - self.offset[2]
        (xa, xb, xc), (ya, yb, yc), (za, zb, zc) = self.matrix
        return xa * a + xb * b + xc * c, ya * a + yb * b + yc * c, za * a + zb * b + zc * c


def battery(data: bytes) -> Battery:
    """Decode the state of a battery from the three bytes of the device's answer.

    data: ADC value of the voltage (uint16, little-endian), state of the charger (1 byte).
    The charge, 0 to 100 %, is computed from the voltage by the maker's polynomial.
    """
    volts = min(max(int.from_bytes(data[:2], "little") * _ADC_V * _DIVIDER, _EMPTY_V), _FULL_V)
    percent = 0.0
    for factor in _PERCENT:
        percent = percent * volts + factor
    return Battery(min(max(percent, 0.0), 100.0), charging=data[2] == _CHARGING)
