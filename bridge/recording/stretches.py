"""Reader of recordings into arrays, one set per stretch.

A stretch is the part of a boot of a device in which sequence numbers rise: usually the whole boot.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.catalogue import in_words
from bridge.recording.column_files import Columns
from bridge.recording.contents import Tell
from bridge.recording.error import RecordingError
from bridge.recording.survey import Boot, Device, survey
from bridge.terminal.plurals import count
from bridge.wire.messages import (
    Calibration,
    CorrectedBatch,
    DeviceInfo,
    Note,
    OrientationBatch,
    Placement,
    SampleBatch,
    Verdict,
)

Singles = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Samples of one boot of a device, as arrays of n rows with rising sequence numbers.

    boot: 64-bit boot number. number: number of the device's stretch, from 1. sequence (n,): sample numbers since boot.
    ticks (n,): device clock, tick_period_s each. time_ns (n,): host time, ns since the Unix epoch.
    gyro (n, 3): rad/s, sensor frame. accel (n, 3): m/s², sensor frame; None if any sample lacks it. temperature_c (n,):
    gaps interpolated; None if no sample has it. flags (n,): SampleFlag bits.

    computed: columns computed live, by name; empty if none were recorded.
    rate_rad_s, rate_std_rad_s, bias_rad_s (n, 3): sensor frame. quality (n,): value of messages.Quality. For a sample
    without a corrected rate, these are NaN and the quality is -1.
    quat_wxyz (n, 4): unit quaternion from sensor to earth, scalar first. tilt_std, heading_std (n,): standard
    deviations, rad, the same for all samples of a message. These three are NaN for a sample without an orientation.
    """

    device: str
    bridge: str
    boot: int
    number: int
    info: DeviceInfo | None
    tick_period_s: float
    sequence: NDArray[np.int64]
    ticks: NDArray[np.uint64]
    time_ns: NDArray[np.int64]
    gyro: Singles
    accel: Singles | None
    temperature_c: Singles | None
    flags: NDArray[np.uint32]
    computed: Columns
    #: where and by whom the device was worn, in order; each holds until the next
    placements: tuple[Placement, ...] = ()

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Time (n,) by the device's clock since the first sample, s."""
        return np.asarray((self.ticks - self.ticks[0]) * self.tick_period_s, dtype=np.float64)

    @property
    def columns(self) -> Columns:
        """Columns (n,), (n, 3) or (n, 4) by name: readings, computed rates, orientation, host_time_ns, sequence, flags.

        Names, shapes and units are those of the .npz file in `bridge.recording.export`.
        """
        found: Columns = {"t_s": self.time_s, "gyro_rad_s": self.gyro}
        if self.accel is not None:
            found["accel_m_s2"] = self.accel
        if self.temperature_c is not None:
            found["temperature_c"] = self.temperature_c
        return found | self.computed | {"host_time_ns": self.time_ns, "sequence": self.sequence, "flags": self.flags}

    @property
    def rate_hz(self) -> float:
        """Output data rate, Hz: as the device states it, else by the median time step.

        0 for a single sample of a device that states no rate.
        """
        if self.info is not None and self.info.rate_hz:
            return self.info.rate_hz
        steps = np.diff(self.time_s) / np.maximum(1, np.diff(self.sequence))
        return float(1 / np.median(steps)) if len(steps) else 0.0


@dataclass(slots=True)
class Recorded:
    """Content of recordings: samples, calibrations and notes.

    stretches: by device id, in order of time; each has the samples of one boot.
    trouble: faults of the files, and messages that could not be decoded, as sentences.
    """

    stretches: dict[str, list[Stretch]]
    calibrations: list[Calibration]
    notes: list[Note]
    trouble: list[str]

    @property
    def begin_ns(self) -> int:
        """Host time of the earliest sample, ns since the Unix epoch; 0 if there is no sample."""
        return min((int(s.time_ns[0]) for stretches in self.stretches.values() for s in stretches), default=0)

    def calibrations_of(self, stretch: Stretch) -> list[Calibration]:
        """Return the accepted calibrations made during a stretch (samples of one boot), in order of time.

        Calibrations with an unknown covariance are left out.
        """
        same = [one for one in self.stretches[stretch.device] if one.boot == stretch.boot]
        at = same.index(stretch)
        since_ns = int(stretch.time_ns[0]) if at else 0
        until_ns = int(same[at + 1].time_ns[0]) if at + 1 < len(same) else np.inf
        made = [
            one
            for one in self.calibrations
            if (one.device, one.boot, one.verdict) == (stretch.device, stretch.boot, Verdict.ACCEPTED)
            and one.parameters  # otherwise its covariance is unknown
            and since_ns <= one.time_ns < until_ns
        ]
        return sorted(made, key=lambda one: one.time_ns)

    def only(self, devices: Sequence[str]) -> "Recorded":
        """Return only the content about the given devices.

        devices: ids. Raises RecordingError for a device without samples.
        """
        for device in devices:
            if device not in self.stretches:
                raise RecordingError(f"no samples of --device {device!r}; choose from {', '.join(self.stretches)}")
        return Recorded(
            {device: self.stretches[device] for device in devices},
            [one for one in self.calibrations if one.device in devices],
            [one for one in self.notes if one.device in devices],
            self.trouble,
        )


def read(paths: Sequence[Path], *, corrected: bool = True, tell: Tell = lambda _done, _of: None) -> Recorded:
    """Read a ward's recordings into arrays: samples, calibrations and notes.

    corrected: True also reads corrected rates and orientation. tell(done, total): called with the number of bytes
    read so far, and of all bytes.
    Raises RecordingError for a file that is not a recording of a ward.
    """
    wanted = ["raw", "info", "status", "calibration", "note", *(["corrected", "orientation"] if corrected else [])]
    found = survey(paths, tell, wanted, keep=True)
    refused = found.refused.as_dict().items()
    trouble = found.trouble + [f"{count(n, 'message')} skipped: {in_words(reason)}" for reason, n in refused]
    stretches = dict[str, list[Stretch]]()
    for name, device in found.devices.items():
        parts = [(boot, batches) for boot in device.boots.values() for batches in boot.kept]
        parts.sort(key=lambda part: part[1][0].start_time_ns)
        rates = sum(len(batch) for boot in device.boots.values() for batch in boot.rates)
        if parts:
            stretches[name] = [_stretch(name, device, *part, number) for number, part in enumerate(parts, 1)]
        elif rates:
            trouble.append(f"{name}: {rates} corrected rates, but no readings")
    return Recorded(
        stretches=stretches,
        calibrations=[one for device in found.devices.values() for one in device.calibrations.values()],
        notes=sorted(
            (one for device in found.devices.values() for one in device.notes.values()), key=lambda n: n.time_ns
        ),
        trouble=trouble,
    )


def _stretch(name: str, device: Device, boot: Boot, batches: list[SampleBatch], number: int) -> Stretch:
    ticks = np.concatenate([batch.ticks for batch in batches])
    sequence = np.concatenate([np.arange(b.sequence, b.sequence + len(b), dtype=np.int64) for b in batches])
    time_ns = np.concatenate([batch.sample_time_ns for batch in batches])
    accels = [batch.accel for batch in batches if batch.accel is not None]
    return Stretch(
        device=name,
        bridge=device.bridge,
        boot=boot.boot,
        number=number,
        info=device.infos.get(boot.boot),
        tick_period_s=batches[0].tick_period_s,
        sequence=sequence,
        ticks=ticks,
        time_ns=time_ns,
        gyro=np.concatenate([batch.gyro for batch in batches]),
        accel=np.concatenate(accels) if len(accels) == len(batches) else None,
        temperature_c=_temperature(batches),
        flags=np.concatenate([batch.flags for batch in batches]),
        computed=_computed(boot, sequence, ticks),
        placements=device.worn(int(time_ns[0]), int(time_ns[-1])),
    )


def _temperature(batches: list[SampleBatch]) -> Singles | None:
    """Return the temperature column, gaps interpolated (temperature changes slowly); None if there is none."""
    parts = [np.full(len(b), np.nan, np.float32) if b.temperature_c is None else b.temperature_c for b in batches]
    column = np.concatenate(parts)
    known = np.flatnonzero(np.isfinite(column))
    if not len(known):
        return None
    return np.interp(np.arange(len(column)), known, column[known]).astype(np.float32)


def _computed(boot: Boot, sequence: NDArray[np.int64], ticks: NDArray[np.uint64]) -> Columns:
    """Return corrected rates and orientation of the samples with these numbers and ticks; of two for a sample, the last."""
    found = dict[str, NDArray[Any]]()
    batches: list[CorrectedBatch | OrientationBatch] = [*boot.rates, *boot.attitudes]
    for batch in batches:
        rows, mine = _rows(batch, sequence, ticks)
        if not len(rows):
            continue
        for name, values in _columns_of(batch).items():
            if name not in found:
                missing = np.nan if values.dtype.kind == "f" else -1
                found[name] = np.full((len(ticks), *values.shape[1:]), missing, values.dtype)
            found[name][rows] = values[mine]
    return found


def _columns_of(batch: CorrectedBatch | OrientationBatch) -> Columns:
    n = len(batch)
    if isinstance(batch, CorrectedBatch):
        std = batch.rate_std.astype(np.float32)
        bias, quality = np.tile(batch.bias, (n, 1)), np.full(n, batch.quality, np.int8)
        return {"rate_rad_s": batch.rate, "rate_std_rad_s": std, "bias_rad_s": bias, "quality": quality}
    tilt, heading = (np.full(n, std, np.float32) for std in (batch.tilt_std, batch.heading_std))
    return {"quat_wxyz": batch.quat_wxyz, "tilt_std": tilt, "heading_std": heading}


def _rows(
    batch: CorrectedBatch | OrientationBatch, sequence: NDArray[np.int64], ticks: NDArray[np.uint64]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the rows of those samples of a batch that have these numbers and ticks, and which samples those are."""
    at = np.searchsorted(ticks, batch.ticks)
    numbers = np.arange(batch.sequence, batch.sequence + len(batch))
    inside = np.minimum(at, len(ticks) - 1)
    mine = (at < len(ticks)) & (ticks[inside] == batch.ticks) & (sequence[inside] == numbers)
    return inside[mine], mine
