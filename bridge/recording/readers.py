"""A recording of one device: samples at their own times, from NumPy's .npz, from CSV, or from a ward's recording (.mcap).

npz: `gyro_rad_s` (n, 3), and where there are `accel_m_s2` (n, 3), `temperature_c` (n,), `t_s` (n,) and `rate_hz`; `device` and
`boot` as an export says them. Other arrays are passed over; `arrival_s` is one of them, for bytes arrive in bursts: it is no
sample time.
CSV: a header row, one row a sample. Columns, the unit in the name:
    t_s | t_ms | t_us                                       time of the sample
    gyro_x_rad_s ... gyro_z_rad_s | gyro_x_dps ... | gyro_x_mdps ...      also gx_dps and so on
    accel_x_m_s2 ... accel_z_m_s2 | accel_x_g ... | accel_x_mg ...        also ax_g and so on
    temperature_c
What is in other columns is passed over, be it numbers or not.
One of t and `rate_hz` (an argument where the file has none) is needed: a rate alone means evenly spaced samples.
mcap: as `truerate record` writes it; the device, and which of its boots, must be said where there are several.
"""

import logging
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.recording import stretches
from bridge.recording.csv_reader import read_csv
from bridge.recording.error import RecordingError, check_file
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
from bridge.recording.stretches import Stretch
from bridge.wire import keys
from bridge.wire.codec import MAX_ACCEL, MAX_CELSIUS, MAX_RATE
from bridge.wire.messages import Calibration
from bridge.wording import count

__all__ = ["Recording", "RecordingError", "Told", "load"]

_log = logging.getLogger(__name__)
Floats = NDArray[np.float64]
#: what a file calls a column, or one of its axes, and where in it a sample is
Place = Callable[..., tuple[str, str]]
MAX_BYTES = 1 << 29  # of the file, and of what it unpacks to
TICK_S = 1e-6  # as a recording is played: as if the device counted microseconds
_MAX_TIME_S = 1e10  # since whatever epoch: 300 years
_SAME_RATE = 1e-3  # relative: as precisely as people write a rate
_BOOT = re.compile("[0-9a-f]{16}")
_WANTED = ("gyro_rad_s", "accel_m_s2", "temperature_c", "t_s", "rate_hz")
_LIMITS = {
    "gyro_rad_s": (MAX_RATE, "rad/s", "is it in degrees per second, or in counts?"),
    "accel_m_s2": (MAX_ACCEL, "m/s²", "is it in milli-g, or in counts?"),
    "temperature_c": (MAX_CELSIUS, "°C", "is it in counts?"),
    "t_s": (_MAX_TIME_S, "s", "is it in microseconds, or in nanoseconds?"),
}


class Told(NamedTuple):
    """The samples as a bridge sent them: ticks (n,) of tick_period_s of the device's clock, sequence (n,), flags (n,)."""

    ticks: NDArray[np.uint64]
    tick_period_s: float
    sequence: NDArray[np.int64]
    flags: NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """n samples: time_s (n,) rising from 0, gyro (n, 3) rad/s, accel (n, 3) m/s² or None, temperature_c (n,) or None.

    rate_hz: as the file says, or as its times do where none is missing. gyro_range: full scale, rad/s; 0 when unknown.
    made: of a ward's recording, the accepted calibrations of this very boot that are in it, in order; begin_ns: host time
    of its first sample; told: as they came. device, boot: whose it is, empty and 0 where that is not known.
    """

    time_s: Floats
    gyro: Floats
    accel: Floats | None
    temperature_c: Floats | None
    rate_hz: float
    name: str
    gyro_range: float = 0.0
    made: tuple[Calibration, ...] = ()
    begin_ns: int = 0
    told: Told | None = None
    device: str = ""
    boot: int = 0

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def ticks(self) -> NDArray[np.uint64]:
        """(n,) the time of each sample in ticks of TICK_S."""
        return np.rint(self.time_s / TICK_S).astype(np.uint64)

    @property
    def device_time(self) -> Floats:
        """(n,) seconds by the device's clock, where that is known: windows begin where they began live."""
        return self.time_s if self.told is None else np.asarray(self.told.ticks * self.told.tick_period_s, np.float64)

    @property
    def sequence(self) -> NDArray[np.int64]:
        """(n,) a number for each sample: where time jumps, the samples that are missing have numbers too."""
        steps = np.diff(self.time_s) * self.rate_hz
        missing = np.where(steps > 1.75, np.rint(steps) - 1, 0)
        return np.arange(len(self)) + np.concatenate([[0], np.cumsum(missing)]).astype(np.int64)


def load(
    path: Path | str, rate_hz: float | None = None, *, device: str | None = None, boot: int | None = None
) -> Recording:
    """Read a recording; rate_hz is used where the file has neither times nor a rate. Raises RecordingError.

    device and boot, counted from 1, choose from a ward's recording.
    """
    path = Path(path)
    kind = path.suffix.lower()
    check_file(path)
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise RecordingError(f"{path}: {size} bytes; at most {MAX_BYTES} are taken")
    if kind == ".part":
        raise RecordingError(f"{path}: it was not finished; make it whole first: truerate recording recover {path}")
    if kind == ".mcap":
        return _of_stretch(path, *_chosen(path, device, boot))
    if device is not None or boot is not None:
        raise RecordingError(f"{path}: it is of one device and one boot; only a .mcap has several to choose from")
    if kind == ".npz":
        arrays, device, boot = _read_npz(path)
        return replace(_checked(path, arrays, rate_hz, _place), device=device, boot=boot)
    if kind in {".csv", ".txt"}:
        table = read_csv(path)
        return _checked(path, table.columns, rate_hz, table.place)
    raise RecordingError(f"{path}: a recording ends in .npz, .csv or .mcap, not in {path.suffix!r}")


def _chosen(path: Path, device: str | None, boot: int | None) -> tuple[Stretch, list[Calibration]]:
    """One boot of one device of a ward's recording, and its calibrations."""
    recorded = stretches.read([path], corrected=False)
    for words in recorded.trouble:
        _log.warning("%s", words)
    found = recorded.stretches
    if not found:
        raise RecordingError(f"{path}: there are no samples in it")
    if device is None and len(found) > 1:
        raise RecordingError(f"{path}: it has {len(found)} devices; choose one by --device: {', '.join(found)}")
    name = next(iter(found)) if device is None else device
    if name not in found:
        raise RecordingError(f"{path}: there are no samples of {name!r} in it; it has {', '.join(found)}")
    boots = found[name]
    if boot is None and len(boots) > 1:
        said = ", ".join(f"{one.number} ({count(len(one), 'sample')}, {one.time_s[-1]:.0f} s)" for one in boots)
        raise RecordingError(f"{path}: {name} was booted {len(boots)} times; choose one by --boot: {said}")
    if boot is not None and not 1 <= boot <= len(boots):
        raise RecordingError(f"{path}: {name} has boots 1 to {len(boots)}, not {boot}")
    chosen = boots[0 if boot is None else boot - 1]
    return chosen, recorded.calibrations_of(chosen)


def _of_stretch(path: Path, of: Stretch, made: list[Calibration]) -> Recording:
    if len(of) < 2:
        raise RecordingError(f"{path}: {count(len(of), 'sample')} of {of.device}; at least 2 are needed")
    gyro = of.gyro.astype(np.float64)
    check_gyro(path, gyro, of.rate_hz)
    return Recording(
        time_s=of.time_s,
        gyro=gyro,
        accel=believed_accel(path, None if of.accel is None else of.accel.astype(np.float64)),
        temperature_c=None if of.temperature_c is None else of.temperature_c.astype(np.float64),
        rate_hz=of.rate_hz,
        name=f"{path.stem}_{of.device}",
        gyro_range=of.info.gyro_range if of.info else 0.0,
        made=tuple(made),
        begin_ns=int(of.time_ns[0]),
        told=Told(of.ticks, of.tick_period_s, of.sequence, of.flags),
        device=of.device,
        boot=of.boot,
    )


def _read_npz(path: Path) -> tuple[dict[str, Floats], str, int]:
    """The wanted arrays of an archive, and whose it is; NumPy's complaints, which advise to load unsafely, are not passed on."""
    if not path.stat().st_size:
        raise RecordingError(f"{path}: it is empty; an archive with 'gyro_rad_s' in it is needed")
    _check_unpacked(path)
    arrays = {}
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            present = list(file.files)
            for name in (name for name in _WANTED if name in present):
                arrays[name] = _array(path, name, file)
            device, boot = (_word(name, file) for name in ("device", "boot"))
    except RecordingError:
        raise
    except Exception:  # noqa: BLE001 - a damaged archive fails in many ways
        raise _unreadable(path) from None
    if "gyro_rad_s" not in arrays:
        raise RecordingError(f"{path}: 'gyro_rad_s' is missing; the file has {', '.join(present) or 'nothing'}")
    # As an export writes them; whatever else is called so tells nothing.
    whose = (device, int(boot, 16)) if keys.ID.match(device) and _BOOT.fullmatch(boot) else ("", 0)
    return {name: _numbers(path, name, array) for name, array in arrays.items()}, *whose


def _check_unpacked(path: Path) -> None:
    """Refuse an archive that is none, or unpacks to too much; zipfile reads no more of a member than is said here."""
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
    except Exception:  # noqa: BLE001 - a damaged archive fails in many ways
        raise _unreadable(path) from None
    if size > MAX_BYTES:
        raise RecordingError(f"{path}: it unpacks to {size} bytes; at most {MAX_BYTES} are taken")


def _array(path: Path, name: str, file: Mapping[str, NDArray[np.generic]]) -> NDArray[np.generic]:
    try:
        return file[name]
    except Exception:  # noqa: BLE001 - as above
        raise RecordingError(
            f"{path}: {name!r} is damaged, or holds no plain numbers; save it as an array of floats"
        ) from None


def _word(name: str, file: Mapping[str, NDArray[np.generic]]) -> str:
    try:
        return str(file[name])
    except Exception:  # noqa: BLE001 - whatever else is called so is passed over
        return ""


def _unreadable(path: Path) -> RecordingError:
    return RecordingError(f"{path}: not a readable .npz: damaged, or of another kind; numpy.savez writes one")


def _numbers(path: Path, name: str, array: NDArray[np.generic]) -> Floats:
    if array.dtype.kind not in "fiu":
        raise RecordingError(f"{path}: {name!r} holds {array.dtype}, not numbers")
    return array.astype(np.float64, copy=False)


def _place(column: str, sample: int, _axis: int = 0) -> tuple[str, str]:
    """As Csv.place has it, of arrays."""
    return repr(column), f" at sample {sample}"


def _checked(path: Path, columns: dict[str, Floats], rate_hz: float | None, place: Place) -> Recording:
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
        _check_values(path, name, column, place)
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
    time = _time(path, columns.get("t_s"), rate, n, place)
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
    )


def _check_values(path: Path, name: str, column: Floats, place: Place) -> None:
    bad = np.argwhere(~np.isfinite(column))
    if len(bad):
        what, where = place(name, *bad[0]) if column.ndim else (repr(name), "")
        raise RecordingError(f"{path}: {what} is not a finite number{where} ({count(len(bad), 'such value')})")
    if name not in _LIMITS:
        return
    limit, unit, words = _LIMITS[name]
    large = np.argwhere(np.abs(column) > limit)
    if len(large):
        what, where = place(name, *large[0])
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
        _, where = place("t_s", at)
        raise RecordingError(
            f"{path}: time does not rise{where}: {time[at - 1]:.10g} s, then {time[at]:.10g} s; a step is "
            f"{TICK_S:g} s or more. Are the times those of arrival? Leave them out, and say the device's rate"
        )
    return since
