"""Checks columns of samples, and makes a Recording of them: whole, finite, in order, in plausible units."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bridge.recording.error import RecordingError
from bridge.recording.plausible import (
    FASTEST_HZ,
    SLOWEST_HZ,
    believed_accel,
    check_gyro,
    check_rate,
    check_time,
    rate_of,
    warn_of_gyro,
)
from bridge.recording.recording import TICK_S, Floats, Recording
from bridge.wire.codec import MAX_ACCEL, MAX_CELSIUS, MAX_RATE
from bridge.wording import count

_log = logging.getLogger(__name__)
_MAX_TIME_S = 1e10  # since whatever epoch: 300 years
_SAME_RATE = 1e-3  # relative: as precisely as people write a rate
_LIMITS = {
    "gyro_rad_s": (MAX_RATE, "rad/s", "is it in degrees per second, or in counts?"),
    "accel_m_s2": (MAX_ACCEL, "m/s²", "is it in milli-g, or in counts?"),
    "temperature_c": (MAX_CELSIUS, "°C", "is it in counts?"),
    "t_s": (_MAX_TIME_S, "s", "is it in microseconds, or in nanoseconds?"),
}
#: arguments: a column, a sample, an axis; results: what the file calls that column or axis, and where in it the sample is
Place = Callable[[str, int, int], tuple[str, str]]


def in_arrays(column: str, sample: int, _axis: int) -> tuple[str, str]:
    """The Place of a file of arrays."""
    return repr(column), f" at sample {sample}"


class Table(NamedTuple):
    """Columns gyro_rad_s (n, 3) and, if known, accel_m_s2 (n, 3), temperature_c (n,), t_s (n,), rate_hz (), device and boot."""

    columns: dict[str, Floats]
    place: Place = in_arrays
    device: str = ""
    boot: int = 0


def recording_of(path: Path, table: Table, rate_hz: float | None) -> Recording:
    """A Recording of a table; rate_hz is used where the file has neither times nor a rate. Raises RecordingError."""
    columns = table.columns
    gyro = columns["gyro_rad_s"]
    if gyro.ndim != 2 or gyro.shape[1] != 3:
        raise RecordingError(f"{path}: 'gyro_rad_s' has shape {gyro.shape}; (n, 3) is expected, a row for each sample")
    n = len(gyro)
    shapes = {"gyro_rad_s": (n, 3), "accel_m_s2": (n, 3), "temperature_c": (n,), "t_s": (n,), "rate_hz": ()}
    for name, column in columns.items():
        if column.shape != shapes[name]:
            raise RecordingError(
                f"{path}: {name!r} has shape {column.shape}; {shapes[name]} is expected, as 'gyro_rad_s' has {count(n, 'sample')}"
            )
        _check_values(path, name, column, table.place)
    if n < 2:
        raise RecordingError(f"{path}: {count(n, 'sample')}; at least 2 are needed")
    rate = float(columns["rate_hz"]) if "rate_hz" in columns else rate_hz
    for said in (rate, rate_hz):
        if said is not None and not SLOWEST_HZ <= said <= FASTEST_HZ:
            raise RecordingError(
                f"{path}: the rate that is told is {said:g} Hz; {SLOWEST_HZ:g} to {FASTEST_HZ:g} is taken"
            )
    if rate_hz is not None and rate is not None and abs(rate_hz - rate) > _SAME_RATE * rate:
        _log.warning("%s: its rate is %.5g Hz by itself; %.5g Hz, as told, is not used", path, rate, rate_hz)
    time = _time(path, columns.get("t_s"), rate, n, table.place)
    if "t_s" in columns:
        check_time(path, time)
        if rate is not None:
            check_rate(path, time, rate)
    check_gyro(path, gyro, 1 / float(np.median(np.diff(time))))
    warn_of_gyro(path, gyro, rate_of(time))
    return Recording(
        time_s=time,
        gyro=gyro,
        accel=believed_accel(path, columns.get("accel_m_s2")),
        temperature_c=columns.get("temperature_c"),
        rate_hz=rate or rate_of(time),
        name=path.stem,
        device=table.device,
        boot=table.boot,
    )


def _check_values(path: Path, name: str, column: Floats, place: Place) -> None:
    bad = np.argwhere(~np.isfinite(column))
    if len(bad):
        what, where = place(name, int(bad[0][0]), int(bad[0][-1])) if column.ndim else (repr(name), "")
        raise RecordingError(f"{path}: {what} is not a finite number{where} ({count(len(bad), 'such value')})")
    if name not in _LIMITS:
        return
    limit, unit, words = _LIMITS[name]
    large = np.argwhere(np.abs(column) > limit)
    if len(large):
        what, where = place(name, int(large[0][0]), int(large[0][-1]))
        value = column[tuple(large[0])]
        raise RecordingError(f"{path}: {what} is {value:g} {unit}{where}; up to ±{limit:g} {unit} is taken; {words}")


def _time(path: Path, time: Floats | None, rate: float | None, n: int, place: Place) -> Floats:
    if time is None:
        if rate is None:
            raise RecordingError(
                f"{path}: it has neither sample times nor 'rate_hz'; say it with --rate-hz, or rate_hz in a ward's file"
            )
        return np.arange(n) / rate
    since = np.asarray(time - time[0])
    # By what it is counted in: two samples of one tick are a clock that stands still, or goes back, as they are cut.
    rises = np.diff(np.rint(since / TICK_S)) > 0
    if not rises.all():
        at = int(np.argmin(rises)) + 1
        _, where = place("t_s", at, 0)
        raise RecordingError(
            f"{path}: time does not rise{where}: {time[at - 1]:.10g} s, then {time[at]:.10g} s; a step is "
            f"{TICK_S:g} s or more. Are the times those of arrival? Leave them out, and say the device's rate"
        )
    return since
