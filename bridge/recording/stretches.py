"""Reads recordings into arrays, by stretches: a stretch is one boot of a device with rising sequence numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.catalogue import in_words
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
#: quality of a sample without a recorded corrected rate
NOT_CORRECTED = -1


@dataclass(frozen=True, slots=True, eq=False)
class Rates:
    """Corrected rates of a Stretch (samples of one boot), one row per sample.

    NaN for a sample without a corrected rate.
    rate, rate_std, bias (n, 3): rad/s, sensor frame, as in a CorrectedBatch.
    quality (n,): number of messages.Quality, or NOT_CORRECTED.
    """

    rate: Singles
    rate_std: Singles
    bias: Singles
    quality: NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class Attitudes:
    """Orientation of a Stretch (samples of one boot), one row per sample; NaN for a sample without one.

    quat_wxyz (n, 4): sensor to earth, scalar first. tilt_std, heading_std (n,): standard deviations in rad, of the last
    sample of the sample's message.
    """

    quat_wxyz: Singles
    tilt_std: Singles
    heading_std: Singles


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Samples of one boot of a device, with rising sequence numbers and ticks (n,).

    boot: boot id. number: of the device's stretch, from 1. tick_period_s: seconds per tick.
    time_ns (n,): host time, ns since the Unix epoch. gyro (n, 3): rad/s.
    accel (n, 3): m/s², None if any sample lacks it. temperature_c (n,): °C, gaps interpolated, None if no sample has
    it. flags (n,): SampleFlag bits. corrected, oriented: None if not recorded.
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
    corrected: Rates | None
    oriented: Attitudes | None = None
    #: where and by whom the device was worn, in order; each holds until the next
    placements: tuple[Placement, ...] = ()

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """(n,) seconds of the device's clock since the first sample."""
        return np.asarray((self.ticks - self.ticks[0]) * self.tick_period_s, dtype=np.float64)

    @property
    def rate_hz(self) -> float:
        """Output data rate in Hz: as the device states it, else by the median step.

        0 for a single sample of an unknown device.
        """
        if self.info is not None and self.info.rate_hz:
            return self.info.rate_hz
        steps = np.diff(self.time_s) / np.maximum(1, np.diff(self.sequence))
        return float(1 / np.median(steps)) if len(steps) else 0.0


@dataclass(slots=True)
class Recorded:
    """Content of recordings: the stretches of each device, by device id and in order of time, calibrations and notes.

    trouble: what is wrong with the files, and which messages were not understood, for the user.
    """

    stretches: dict[str, list[Stretch]]
    calibrations: list[Calibration]
    notes: list[Note]
    trouble: list[str]

    @property
    def begin_ns(self) -> int:
        """Host time of the earliest sample, ns since the Unix epoch; 0 if there is none."""
        return min((int(s.time_ns[0]) for stretches in self.stretches.values() for s in stretches), default=0)

    def calibrations_of(self, stretch: Stretch) -> list[Calibration]:
        """Return the accepted calibrations made during a stretch (samples of one boot), in order of time.

        Calibrations whose covariance is unknown are left out.
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
        """Return the content of these devices alone; devices: ids. Raises RecordingError for an unknown device."""
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
    """Read ward recordings completely into arrays. Raises RecordingError for a file that is not a recording of a ward.

    corrected: also read corrected rates and orientation. tell(done, total): progress in bytes.
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
        corrected=_rates(boot.rates, sequence, ticks),
        oriented=_attitudes(boot.attitudes, sequence, ticks),
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


def _rates(batches: list[CorrectedBatch], sequence: NDArray[np.int64], ticks: NDArray[np.uint64]) -> Rates | None:
    """Return corrected rates for the samples with these numbers and ticks; of a sample corrected twice, the last."""
    rates = Rates(
        rate=np.full((len(ticks), 3), np.nan, np.float32),
        rate_std=np.full((len(ticks), 3), np.nan, np.float32),
        bias=np.full((len(ticks), 3), np.nan, np.float32),
        quality=np.full(len(ticks), NOT_CORRECTED, np.int8),
    )
    for batch in batches:
        rows, mine = _rows(batch, sequence, ticks)
        rates.rate[rows], rates.rate_std[rows] = batch.rate[mine], batch.rate_std[mine]
        rates.bias[rows], rates.quality[rows] = batch.bias, batch.quality
    return rates if (rates.quality != NOT_CORRECTED).any() else None


def _attitudes(
    batches: list[OrientationBatch], sequence: NDArray[np.int64], ticks: NDArray[np.uint64]
) -> Attitudes | None:
    """Return the orientation of the samples with these numbers and ticks; of a sample in two messages, the last."""
    n = len(ticks)
    found = Attitudes(np.full((n, 4), np.nan, np.float32), *(np.full(n, np.nan, np.float32) for _ in range(2)))
    for batch in batches:
        rows, mine = _rows(batch, sequence, ticks)
        found.quat_wxyz[rows] = batch.quat_wxyz[mine]
        found.tilt_std[rows], found.heading_std[rows] = batch.tilt_std, batch.heading_std
    return found if np.isfinite(found.tilt_std).any() else None


def _rows(
    batch: CorrectedBatch | OrientationBatch, sequence: NDArray[np.int64], ticks: NDArray[np.uint64]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the rows of those samples of a batch that have these numbers and ticks, and which samples those are."""
    at = np.searchsorted(ticks, batch.ticks)
    numbers = np.arange(batch.sequence, batch.sequence + len(batch))
    inside = np.minimum(at, len(ticks) - 1)
    mine = (at < len(ticks)) & (ticks[inside] == batch.ticks) & (sequence[inside] == numbers)
    return inside[mine], mine
