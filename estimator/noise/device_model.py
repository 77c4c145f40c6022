"""Noise models of device kinds: expected noise, bias and scale, one TOML file per kind.

    model = "mpu-6050"
    stated_as = ["MPU6050"]     optional: other names of the kind, as devices state them
    [gyro]                      a number, or a list of three for x, y and z
    arw_dps_per_sqrt_hz         angle random walk: noise density of the rate
    bias_instability_dps        bias instability: flat part of the Allan deviation, divided by 0.664
    rrw_dps_per_sqrt_s          rate random walk: how fast the bias wanders at constant temperature
    step_dps                    smallest difference between two readings
                                the keys below take one number, not a list
    range_dps                   full-scale range of the reading, ±
    bias_dps_per_kelvin         temperature coefficient of the bias, ±
    turn_on_bias_dps            largest turn-on bias, ±
    scale_tolerance             largest deviation of the scale factor from 1, ± (0.03 is 3 %)
    [accel]                     optional
    noise_mg_per_sqrt_hz, zero_g_mg

The files that come with truerate are in configs/devices, or in the installed package.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import radians
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from bridge.toml.loader import load
from bridge.toml.shipped import file_of
from bridge.toml.shipped import shipped as in_folders

Floats = NDArray[np.float64]
GENERIC = "generic"
_G = 9.80665
_HERE = Path(__file__).parent.parent
_FOLDERS = (_HERE / "devices", _HERE.parent / "configs" / "devices")  # installed package; checkout


@dataclass(frozen=True, slots=True, eq=False)
class NoiseModel:
    """Noise model of a device kind in SI units; (3,) is x, y, z, and a plain number is for all axes.

    arw (3,): angle random walk, rad/s/√Hz. bias_instability (3,): rad/s. rrw (3,): rate random walk, rad/s/√s.
    step (3,): rounding step, rad/s. gyro_range: full-scale range, rad/s.
    turn_on_bias: largest turn-on bias, rad/s. bias_per_kelvin: rad/s/K.
    scale_tolerance: largest relative deviation of the scale factor from 1.
    accel_noise (m/s²/√Hz), zero_g (m/s²): accelerometer noise and offset; None where unknown.
    """

    model: str
    arw: Floats
    bias_instability: Floats
    rrw: Floats
    step: Floats
    gyro_range: float
    bias_per_kelvin: float
    turn_on_bias: float
    scale_tolerance: float
    accel_noise: float | None = None
    zero_g: float | None = None


Axes = float | tuple[float, float, float]
#: upper limit of every value, whatever its unit
_MOST = 1e5
#: keys that must be above 0: with 0 the filter would take the bias as known for ever
_NEEDED = ("arw_dps_per_sqrt_hz", "rrw_dps_per_sqrt_s", "step_dps", "range_dps", "turn_on_bias_dps")


def _check(table: Struct, more_than_zero: tuple[str, ...] = ()) -> None:
    for key in table.__struct_fields__:
        value = getattr(table, key)
        for number in () if value is None else np.ravel(value):
            if not 0 <= number <= _MOST or (key in more_than_zero and number == 0):
                least = "above 0" if key in more_than_zero else "from 0"
                raise ValueError(f"{key} is {number:g}: use a number {least}, up to {_MOST:g}")


class _Gyro(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    arw_dps_per_sqrt_hz: Axes
    bias_instability_dps: Axes
    rrw_dps_per_sqrt_s: Axes
    step_dps: Axes
    range_dps: float
    bias_dps_per_kelvin: float
    turn_on_bias_dps: float
    scale_tolerance: float

    def __post_init__(self) -> None:
        _check(self, more_than_zero=_NEEDED)


class _Accel(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    noise_mg_per_sqrt_hz: float | None = None
    zero_g_mg: float | None = None

    def __post_init__(self) -> None:
        _check(self)


class _File(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    model: str
    stated_as: tuple[str, ...] = ()
    gyro: _Gyro
    accel: _Accel = _Accel()

    def __post_init__(self) -> None:
        if not (self.model and self.model.isprintable()):
            raise ValueError(f"model is {self.model!r}: give a printable name")


def load_model(name: str | Path) -> NoiseModel:
    """Load the noise model of a device kind: by name if it comes with truerate, else by the path of its .toml file.

    Raises ConfigError for an unknown name or an invalid file.
    """
    file = load(file_of(name, "device model", _FOLDERS), _File)
    gyro, accel = file.gyro, file.accel
    return NoiseModel(
        model=file.model,
        arw=_axes(gyro.arw_dps_per_sqrt_hz),
        bias_instability=_axes(gyro.bias_instability_dps),
        rrw=_axes(gyro.rrw_dps_per_sqrt_s),
        step=_axes(gyro.step_dps),
        gyro_range=radians(gyro.range_dps),
        bias_per_kelvin=radians(gyro.bias_dps_per_kelvin),
        turn_on_bias=radians(gyro.turn_on_bias_dps),
        scale_tolerance=gyro.scale_tolerance,
        accel_noise=_from_mg(accel.noise_mg_per_sqrt_hz),
        zero_g=_from_mg(accel.zero_g_mg),
    )


def model_stated(words: str) -> str:
    """Name of the shipped device model that a device's description mentions, such as `Arduino Nano 33 BLE (LSM9DS1)`.

    Empty if it mentions none.
    """
    return next((name for name, pattern in _spoken().items() if pattern.search(words)), "")


@cache
def _spoken() -> dict[str, re.Pattern[str]]:
    """Patterns of the shipped models' names and other names, as whole words."""
    return {
        name: re.compile(
            rf"(?<![a-z0-9])(?:{'|'.join(map(re.escape, (name, *load(path, _File).stated_as)))})(?![a-z0-9])",
            re.IGNORECASE,
        )
        for name, path in shipped().items()
    }


def shipped() -> dict[str, Path]:
    """Device models that come with truerate: paths of their .toml files by name."""
    return in_folders(_FOLDERS)


def as_toml(model: NoiseModel, origin: Mapping[str, str], head: str) -> str:
    """Format a device model as TOML text that load_model reads, each value in the file's units with a comment.

    origin: by field, a comment on the source of its value. head: comment at the top of the file.
    """
    gyro = {
        "arw_dps_per_sqrt_hz": ("arw", np.degrees(model.arw)),
        "bias_instability_dps": ("bias_instability", np.degrees(model.bias_instability)),
        "rrw_dps_per_sqrt_s": ("rrw", np.degrees(model.rrw)),
        "step_dps": ("step", np.degrees(model.step)),
        "range_dps": ("gyro_range", np.degrees(model.gyro_range)),
        "bias_dps_per_kelvin": ("bias_per_kelvin", np.degrees(model.bias_per_kelvin)),
        "turn_on_bias_dps": ("turn_on_bias", np.degrees(model.turn_on_bias)),
        "scale_tolerance": ("scale_tolerance", model.scale_tolerance),
    }
    accel = {
        "noise_mg_per_sqrt_hz": ("accel_noise", model.accel_noise),
        "zero_g_mg": ("zero_g", model.zero_g),
    }
    known = {key: (field, 1e3 * value / _G) for key, (field, value) in accel.items() if value is not None}
    lines = [*(f"# {line}" for line in head.splitlines()), f"model = {json.dumps(model.model, ensure_ascii=False)}"]
    for table, values in (("gyro", gyro), ("accel", known)):
        lines += ["", f"[{table}]"] if values else []
        lines += [_line(key, value, origin.get(field, "")) for key, (field, value) in values.items()]
    return "\n".join(lines) + "\n"


def _line(key: str, value: Floats | float, said: str) -> str:
    numbers = [f"{number:.4g}" for number in np.ravel(value)]
    text = numbers[0] if len(numbers) == 1 else f"[{', '.join(numbers)}]"
    return f"{key} = {text}" + (f"  # {said}" if said else "")


def _axes(value: Axes) -> Floats:
    return np.full(3, np.radians(value))


def _from_mg(value: float | None) -> float | None:
    return None if value is None else value * _G / 1e3
