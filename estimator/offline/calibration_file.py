"""Calibration file: a calibration as JSON, in the format that `truerate calibrate --json` prints.

The file contains everything that a later correction needs.
"""

from itertools import permutations
from math import degrees, isfinite, radians
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from bridge.reasons.catalogue import english, sentences_as_json
from bridge.reasons.codes import Sentence, Sentences
from bridge.recording import Recording
from bridge.wire import keys
from bridge.wire.codec import MAX_CELSIUS, MAX_RATE
from bridge.wire.messages import AccelerometerCalibration, Calibration, Turn, Verdict
from estimator.calibration.result import K_MAX, K_MIN, PARAMETERS, Result
from estimator.geometry.gyro_model import AXES, Floats, PriorKnobs

FORMAT, VERSION = "truerate calibration", 1
_MAX_BYTES = 1 << 20
#: largest cross-axis element of a plausible matrix (misalignment in rad); a larger one is not a calibration matrix
_MOST_ACROSS = 0.3
#: largest plausible bias and noise of a gyro at rest, rad/s; a larger value is probably in °/s
_MOST_BIAS, _MOST_NOISE = 1.0, 0.1
#: least plausible noise, rad/s; a gyro that shows less rounds its noise away, and the step size describes that
_LEAST_NOISE = 1e-6
#: largest plausible bias of an accelerometer, m/s²
_MOST_FORCE = 5.0
#: least plausible standard deviation of any parameter, in its own unit: rad/s, or relative for the scale
_LEAST_STD = 1e-9
_ACROSS = tuple(f"m_{AXES[i]}{AXES[j]}" for i, j in permutations(range(3), 2))
_ADVICE = "`truerate calibrate RECORDING --json > FILE` writes one"

_Name = Annotated[str, msgspec.Meta(max_length=64)]
_Row = Annotated[list[float], msgspec.Meta(min_length=3, max_length=3)]


class CalibrationFileError(Exception):
    """Error of a calibration file that cannot be used.

    The message states the file, what it contains, what was expected, and what to do.
    """


class _Turn(msgspec.Struct, frozen=True):
    axis: str
    angle_deg: float
    closure_error_deg: float
    duration_s: float


class _Sentence(msgspec.Struct, frozen=True):
    """A reason: its code and parameters; the file's text beside them is for people and is not read."""

    code: str
    params: dict[str, str] = {}


class _Accelerometer(msgspec.Struct, frozen=True):
    """Keys that are read of an accelerometer's calibration; None where it was not accepted."""

    verdict: str
    poses: int = 0
    bias_m_s2: _Row | None = None
    scale: _Row | None = None
    covariance: list[list[float]] | None = None
    cross_std: float = 0.0
    reason: list[_Sentence] = []


class _File(msgspec.Struct, frozen=True):
    """Keys that are read from a calibration file; other keys are ignored.

    None where there is no estimate, or the value is not known.
    """

    format: str
    version: int
    method: _Name
    verdict: str
    matrix: Annotated[list[_Row], msgspec.Meta(min_length=3, max_length=3)] | None
    bias_rad_s: _Row | None
    parameters: list[_Name]
    covariance: list[list[float]] | None
    noise_std_rad_s: _Row | None
    id: _Name = ""
    device: _Name = ""
    boot: Annotated[str, msgspec.Meta(pattern="^([0-9a-f]{16})?$")] = ""
    reason: list[_Sentence] = []
    turns: tuple[_Turn, ...] = ()
    model: _Name = ""
    firmware: _Name = ""
    gyro_range_rad_s: float = 0.0
    rate_hz: float = 0.0
    temperature_c: float | None = None
    accelerometer: _Accelerometer | None = None


def of_result(result: Result, recording: Recording | None = None, gyro_range: float = 0.0) -> Calibration:
    """Make a Calibration from a result, with the output data rate (Hz) and temperature (°C) of its recording.

    recording: the calibrated recording; None leaves device, boot, id, rate and temperature unknown.
    gyro_range: full-scale range, rad/s; 0 when unknown.
    The temperature is that at `result.bias_time`, the time to which the bias refers; NaN when unknown.
    """
    warm = None if recording is None else recording.temperature_c
    celsius = np.nan if recording is None or warm is None else np.interp(result.bias_time, recording.time_s, warm)
    return Calibration(
        device=recording.device if recording else "",
        boot=recording.boot if recording else 0,
        id=recording.name[:64] if recording else "",
        time_ns=0,
        method=result.method,
        verdict=result.verdict,
        reason=result.reason,
        matrix=result.matrix,
        bias=result.bias,
        parameters=result.parameters,
        covariance=result.covariance,
        turns=result.turns,
        noise_std=result.noise_std,
        model="",
        firmware="",
        gyro_range=gyro_range,
        rate_hz=recording.rate_hz if recording else 0.0,
        temperature_c=float(celsius),
        who="",
        accelerometer=result.accelerometer,
    )


def as_json(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as JSON-compatible values, as `truerate calibrate --json` prints them.

    Identity: format, version, id, device, boot (16 hexadecimal digits), model, firmware, method.
    Result: verdict, reason, turns (axis, angle_deg, closure_error_deg, duration_s), accelerometer (as in
    `accelerometer_as_json`, or None).
    Estimate, None if there is none: matrix (3, 3) without unit, bias_rad_s (3,), noise_std_rad_s (3,), and covariance
    (p, p) of the p `parameters`, whose names are always given.
    Conditions: gyro_range_rad_s, rate_hz, temperature_c (None if unknown).
    """
    c = calibration
    known = bool(len(c.covariance)) and bool(np.all(np.isfinite(c.covariance)))
    return {
        "format": FORMAT,
        "version": VERSION,
        "id": c.id,
        "device": c.device,
        "boot": keys.boot_id(c.boot) if c.boot else "",
        "method": c.method,
        "verdict": c.verdict.name.lower(),
        "reason": sentences_as_json(c.reason),
        "matrix": c.matrix.tolist() if known else None,
        "bias_rad_s": c.bias.tolist() if known else None,
        "parameters": list(c.parameters),
        "covariance": c.covariance.tolist() if known else None,
        "noise_std_rad_s": c.noise_std.tolist() if known else None,
        "turns": [
            {
                "axis": AXES[turn.axis],
                "angle_deg": degrees(turn.angle),
                "closure_error_deg": degrees(turn.closure_error),
                "duration_s": turn.duration_s,
            }
            for turn in c.turns
        ],
        "model": c.model,
        "firmware": c.firmware,
        "gyro_range_rad_s": c.gyro_range,
        "rate_hz": c.rate_hz,
        "temperature_c": c.temperature_c if isfinite(c.temperature_c) else None,
        "accelerometer": None if c.accelerometer is None else accelerometer_as_json(c.accelerometer),
    }


def accelerometer_as_json(one: AccelerometerCalibration) -> dict[str, Any]:
    """Return an accelerometer's calibration as JSON-compatible values.

    Keys: verdict, reason, poses (number of poses), bias_m_s2 (3,), scale (3,) without unit, covariance (6, 6) of bias
    then scale, and cross_std (cross-axis sensitivity, without unit).
    Bias, scale and covariance are None if the calibration is not accepted.
    """
    return {
        "verdict": one.verdict.name.lower(),
        "reason": sentences_as_json(one.reason),
        "poses": one.poses,
        "bias_m_s2": list(one.bias) or None,
        "scale": list(one.scale) or None,
        "covariance": np.reshape(one.covariance, (6, 6)).tolist() if one.covariance else None,
        "cross_std": one.cross_std,
    }


def load(path: Path | str) -> Calibration:
    """Read an accepted calibration from a file and check that its values are plausible.

    The file has no time, so `time_ns` is 0. Device and boot may be absent.
    Raises CalibrationFileError for an unreadable file, a rejected calibration, or an implausible value.
    """
    path = Path(path)
    file = _read(path)
    if (file.format, file.version) != (FORMAT, VERSION):
        raise CalibrationFileError(
            f"{path}: the format is {file.format[:64]!r}, version {file.version}; {FORMAT!r}, version {VERSION}, is expected"
        )
    if file.verdict != "accepted":
        raise CalibrationFileError(
            f"{path}: its verdict is {file.verdict[:64]!r}, not 'accepted' ({english(*_reason(file))[:200]}): calibrate again"
        )
    if file.matrix is None or file.bias_rad_s is None or file.covariance is None or file.noise_std_rad_s is None:
        raise CalibrationFileError(f"{path}: it holds no estimate (null): calibrate again; {_ADVICE}")
    try:
        return Calibration(
            device=file.device,
            boot=int(file.boot or "0", 16),
            id=file.id or path.stem[:64],
            time_ns=0,
            method=file.method,
            verdict=Verdict.ACCEPTED,
            reason=_reason(file),
            matrix=_matrix(np.array(file.matrix)),
            bias=_bias(np.array(file.bias_rad_s), file.gyro_range_rad_s),
            parameters=(names := _parameters(tuple(file.parameters))),
            covariance=_covariance(file.covariance, len(names)),
            turns=tuple(map(_turn, file.turns)),
            noise_std=_within("noise_std_rad_s", np.array(file.noise_std_rad_s), _LEAST_NOISE, _MOST_NOISE),
            model=file.model,
            firmware=file.firmware,
            gyro_range=float(_within("gyro_range_rad_s", np.array(file.gyro_range_rad_s), 0.0, MAX_RATE)),
            rate_hz=float(_within("rate_hz", np.array(file.rate_hz), 0.0, 1e6)),
            temperature_c=_celsius(file.temperature_c),
            who="",
            accelerometer=_accelerometer(file.accelerometer),
        )
    except ValueError as error:
        raise CalibrationFileError(f"{path}: {error}; {_ADVICE}") from None


def _accelerometer(file: _Accelerometer | None) -> AccelerometerCalibration | None:
    if file is None:
        return None
    if file.verdict != "accepted" or file.bias_m_s2 is None or file.scale is None or file.covariance is None:
        verdict = Verdict.REFUSED if file.verdict == "refused" else Verdict.REPEAT
        return AccelerometerCalibration(verdict, _reason(file), file.poses)
    covariance = _symmetric("'covariance' of the accelerometer", file.covariance, 6)
    return AccelerometerCalibration(
        Verdict.ACCEPTED,
        _reason(file),
        file.poses,
        tuple(_within("bias_m_s2", np.array(file.bias_m_s2), -_MOST_FORCE, _MOST_FORCE).tolist()),
        tuple(_within("scale of the accelerometer", np.array(file.scale), 0.5, 2.0).tolist()),
        tuple(covariance.ravel().tolist()),
        float(_within("cross_std", np.array(file.cross_std), 0.0, _MOST_ACROSS)),
    )


def _reason(file: _File | _Accelerometer) -> Sentences:
    return tuple(Sentence(one.code, one.params) for one in file.reason)


def _read(path: Path) -> _File:
    try:
        if (size := path.stat().st_size) > _MAX_BYTES:
            raise CalibrationFileError(
                f"{path}: not a calibration: the file has {size} bytes, more than {_MAX_BYTES}; {_ADVICE}"
            )
        data = path.read_bytes()
    except OSError as error:
        raise CalibrationFileError(f"{path}: cannot be read: {error.strerror}; {_ADVICE}") from None
    try:
        return msgspec.json.decode(data, type=_File)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise CalibrationFileError(f"{path}: not a calibration: {error}; {_ADVICE}") from None


def _matrix(matrix: Floats) -> Floats:
    _within("the diagonal of 'matrix'", np.diag(matrix), K_MIN, K_MAX)
    _within("'matrix' outside its diagonal", matrix[~np.eye(3, dtype=bool)], -_MOST_ACROSS, _MOST_ACROSS)
    return matrix


def _bias(bias: Floats, gyro_range: float) -> Floats:
    most = min(_MOST_BIAS, gyro_range) if gyro_range > 0 else _MOST_BIAS
    return _within("bias_rad_s", bias, -most, most)


def _parameters(names: tuple[str, ...]) -> tuple[str, ...]:
    across = names[len(PARAMETERS) :]
    if names[: len(PARAMETERS)] != PARAMETERS or len(set(across)) != len(across) or not set(across) <= set(_ACROSS):
        known = f"{', '.join(PARAMETERS)}, and any of {', '.join(_ACROSS)}"
        raise ValueError(f"'parameters' are {', '.join(names)[:200]}; {known} are expected")
    return names


def _covariance(rows: list[list[float]], n: int) -> Floats:
    covariance = _symmetric("'covariance'", rows, n)
    std, prior = np.sqrt(np.diag(covariance)), PriorKnobs()
    for name, part, most in (("bias_rad_s", slice(0, 3), prior.bias_std), ("k", slice(3, 6), prior.scale_std)):
        if std[part].max() > most:
            raise ValueError(
                f"'covariance' gives {name} the standard deviation {std[part].max():.3g}; at most {most:.3g}, that of an "
                f"uncalibrated gyro, is allowed"
            )
    return covariance


def _symmetric(name: str, rows: list[list[float]], n: int) -> Floats:
    """Check that rows are a covariance matrix (n, n)."""
    if len(rows) != n or any(len(row) != n for row in rows):
        raise ValueError(f"{name} is not {n} × {n}, a row and a column for each parameter")
    covariance = np.array(rows)
    if not np.isfinite(covariance).all() or np.any(np.diag(covariance) <= 0):
        raise ValueError(f"{name} has a variance that is not above 0, or not finite")
    std = np.sqrt(np.diag(covariance))
    if std.min() < _LEAST_STD:
        raise ValueError(
            f"{name} gives a parameter the standard deviation {std.min():.3g}; at least {_LEAST_STD:g} is expected"
        )
    correlation = covariance / np.outer(std, std)
    if np.abs(correlation - correlation.T).max() > 1e-6:
        raise ValueError(f"{name} is not symmetric")
    if (least := np.linalg.eigvalsh(correlation)[0]) < -1e-6:
        raise ValueError(f"{name} is not a covariance: it has an eigenvalue below 0 ({least:.2g} of the correlations)")
    return covariance


def _within(name: str, values: Floats, low: float, high: float) -> Floats:
    if not np.all((values >= low) & (values <= high)):
        raise ValueError(f"{name} is {np.round(values, 5).tolist()}; allowed: {low:g} to {high:g}")
    return values


def _celsius(value: float | None) -> float:
    return (
        float("nan") if value is None else float(_within("temperature_c", np.array(value), -MAX_CELSIUS, MAX_CELSIUS))
    )


def _turn(turn: _Turn) -> Turn:
    if len(turn.axis) != 1 or turn.axis not in AXES:
        raise ValueError(f"the axis of a turn is {turn.axis[:16]!r}; x, y or z is expected")
    return Turn(AXES.index(turn.axis), radians(turn.angle_deg), radians(turn.closure_error_deg), turn.duration_s)
