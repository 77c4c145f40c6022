"""Conversion of columns of samples to a Recording: repairs or refuses bad rows and times, and checks units."""

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bridge.recording.bad_rows import Place, drop_bad_rows, in_arrays
from bridge.recording.error import RecordingError
from bridge.recording.formats.streams import choose_boot
from bridge.recording.plausibility import (
    FASTEST_HZ,
    SLOWEST_HZ,
    believed_accel,
    check_gyro,
    doubts_of_gyro,
    rate_of,
)
from bridge.recording.reading import Reading
from bridge.recording.recording import Floats, Recording
from bridge.recording.sample_times import sample_times
from bridge.terminal.plurals import count

_log = logging.getLogger(__name__)
_SAME_RATE = 1e-3  # relative: as precisely as people write a rate


@dataclass(slots=True)
class Table:
    """Columns of samples as the reader of a file format returns them, before repairs, in SI units, sensor frame.

    columns: gyro_rad_s (n, 3) and, if known, accel_m_s2 (n, 3), temperature_c (n,), t_s (n,), counter (n,), rate_hz ().
    place(column, row, axis): returns the name of a value in the file and the text of its position, for errors.
    device: id, empty if unknown. boot: 64-bit boot number, 0 if unknown.
    model: empty if unknown. tick_s: duration of one count of the file's time column, s; 0 if unknown.
    notes: sentences for the user on the reader's assumptions.
    """

    columns: dict[str, Floats]
    place: Place = in_arrays
    device: str = ""
    boot: int = 0
    model: str = ""
    notes: list[str] = field(default_factory=list)
    tick_s: float = 0.0


def recording_of(path: Path, table: Table, reading: Reading) -> Recording:
    """Make a Recording from a table: repair rows and times, check the units, choose the boot.

    path: the file, for its name and errors. reading: the options given by the user.
    Raises RecordingError if the data is implausible, or if there are several boots and none is chosen.
    """
    columns, notes = dict(table.columns), list(table.notes)
    _check_shapes(path, columns)
    rate = _rate(path, columns, reading)
    drop_bad_rows(path, columns, table.place, notes)
    time, parts = sample_times(path, columns, table.tick_s, rate, reading, notes)
    ends = [*parts[1:], len(time)]
    sizes = [end - start for start, end in zip(parts, ends, strict=True)]
    at = choose_boot(path, sizes, reading.boot, "the device" if len(parts) == 1 else "the rebooted device")
    chosen = slice(parts[at], ends[at])
    time = time[chosen] - time[chosen][0]
    gyro = columns["gyro_rad_s"][chosen]
    accel = columns.get("accel_m_s2")
    warm = columns.get("temperature_c")
    measured_hz = rate_of(time)
    accel = believed(path, gyro, None if accel is None else accel[chosen], measured_hz, notes)
    return Recording(
        time_s=time,
        gyro=gyro,
        accel=accel,
        temperature_c=None if warm is None else warm[chosen],
        rate_hz=rate or measured_hz,
        name=path.stem,
        device=table.device,
        boot=table.boot,
        model=table.model,
        notes=tuple(notes),
    )


def believed(path: Path, gyro: Floats, accel: Floats | None, rate_hz: float, notes: list[str]) -> Floats | None:
    """Check gyro and acceleration, and return the acceleration (n, 3), m/s²; None if it is implausible.

    gyro (n, 3): rad/s. accel (n, 3): m/s², or None. rate_hz: sampling rate. path: the file's name in messages.
    notes: a sentence is added for each doubt; all notes are logged.
    Raises RecordingError for impossible gyro readings.
    """
    check_gyro(path, gyro, rate_hz)
    notes += doubts_of_gyro(gyro, rate_hz)
    accel, said = believed_accel(accel)
    notes += [said] if said else []
    for words in notes:
        _log.warning("%s: %s", path, words)
    return accel


def _check_shapes(path: Path, columns: dict[str, Floats]) -> None:
    gyro = columns["gyro_rad_s"]
    if gyro.ndim != 2 or gyro.shape[1] != 3:
        raise RecordingError(f"{path}: 'gyro_rad_s' has shape {gyro.shape}: give (n, 3), one row per sample")
    n = len(gyro)
    shapes = {
        "gyro_rad_s": (n, 3),
        "accel_m_s2": (n, 3),
        "temperature_c": (n,),
        "t_s": (n,),
        "counter": (n,),
        "rate_hz": (),
    }
    for name, column in columns.items():
        if column.shape != shapes[name]:
            raise RecordingError(
                f"{path}: {name!r} has shape {column.shape}: give {shapes[name]}, because 'gyro_rad_s' has {count(n, 'sample')}"
            )
    if n < 2:
        raise RecordingError(f"{path}: the file has {count(n, 'sample')}; at least 2 are needed")


def _rate(path: Path, columns: dict[str, Floats], reading: Reading) -> float | None:
    own = float(columns["rate_hz"]) if "rate_hz" in columns else None
    if own is not None and not np.isfinite(own):
        raise RecordingError(f"{path}: 'rate_hz' is not a finite number: give the rate with --rate-hz")
    for said in (own, reading.rate_hz):
        if said is not None and not SLOWEST_HZ <= said <= FASTEST_HZ:
            raise RecordingError(
                f"{path}: the stated rate is {said:g} Hz: give --rate-hz from {SLOWEST_HZ:g} to {FASTEST_HZ:g}"
            )
    if own is not None and reading.rate_hz is not None and abs(reading.rate_hz - own) > _SAME_RATE * own:
        _log.warning("%s: the file states %.5g Hz; the given %.5g Hz is used", path, own, reading.rate_hz)
    return reading.rate_hz or own
