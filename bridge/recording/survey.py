"""Surveys recordings, file by file: devices, boots, rates, gaps, calibrations and notes; keeps the samples where asked to."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bridge.recording.contents import Contents, Tell
from bridge.recording.numbering import Numbering
from bridge.wire.messages import Calibration, CorrectedBatch, DeviceInfo, Note, Quality, SampleBatch
from bridge.wire.refusal import Tally


@dataclass(slots=True)
class Boot:
    """One boot of a device: host times of its first and last sample, samples, and what is missing between them.

    corrected: samples by quality, each once, from the first reading to the last: a reader who came late was told of some
    before them. kept: the readings, each once, in parts where numbers begin anew; rates: corrected rates as they came.
    """

    boot: int
    first_ns: int = 0
    last_ns: int = 0
    samples: int = 0
    missing: int = 0
    gaps: int = 0
    repeated: int = 0
    device_s: float = 0.0
    first: int = 0  # number of the first reading, and the one after the last
    end: int = 0
    kept: list[list[SampleBatch]] = field(default_factory=list)
    rates: list[CorrectedBatch] = field(default_factory=list)
    _numbering: Numbering = field(default_factory=Numbering)
    _rated: Numbering = field(default_factory=Numbering)
    _runs: list[tuple[int, int, str]] = field(default_factory=list)  # first number, the one after the last, quality

    @property
    def rate_hz(self) -> float:
        """Samples a device second, missing ones included; 0 when unknown."""
        return (self.samples + self.missing - 1) / self.device_s if self.device_s > 0 else 0.0

    @property
    def corrected(self) -> Counter[str]:
        """Corrected samples by quality."""
        found = Counter[str]()
        for first, end, quality in self._runs if self.samples else ():
            found[quality] += max(0, end - max(first, self.first))
        return +found

    def read(self, batch: SampleBatch, *, keep: bool) -> None:
        """Count readings in."""
        skip, missing, anew, step = self._numbering.follow(batch)
        self.repeated += skip
        if skip == len(batch):
            return
        times = batch.sample_time_ns
        if keep:
            self.kept += [[]] if anew else []
            self.kept[-1].append(batch.after(skip) if skip else batch)
        if anew:
            self.gaps += bool(self.samples)
        else:
            self.missing += missing
            self.gaps += bool(missing)
            self.device_s += step * batch.tick_period_s
        self.device_s += float(batch.ticks[-1] - batch.ticks[skip]) * batch.tick_period_s
        if not self.samples or batch.sequence < self.first:
            self.first = batch.sequence + skip
        self.first_ns = min(self.first_ns or int(times[skip]), int(times[skip]))
        self.last_ns = max(self.last_ns, int(times[-1]))
        self.samples += len(batch) - skip
        self.end = batch.sequence + len(batch)

    def rated(self, batch: CorrectedBatch, *, keep: bool) -> None:
        """Count corrected rates in."""
        if keep:
            self.rates.append(batch)
        skip, _, anew, _ = self._rated.follow(batch)
        if skip < len(batch):
            first, quality = batch.sequence + skip, Quality(batch.quality).name
            if not anew and self._runs[-1][1:] == (first, quality):
                first = self._runs.pop()[0]
            self._runs.append((first, batch.sequence + len(batch), quality))


@dataclass(slots=True)
class Device:
    """What is known of a device: its boots by number, what it says of itself in each, calibrations and notes in order."""

    bridge: str = ""
    infos: dict[int, DeviceInfo] = field(default_factory=dict)
    boots: dict[int, Boot] = field(default_factory=dict)
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    notes: dict[tuple[int, str], Note] = field(default_factory=dict)

    @property
    def info(self) -> DeviceInfo | None:
        """What the device said of itself in its last boot."""
        return next(reversed(self.infos.values()), None)


@dataclass(slots=True)
class Survey:
    """Summary of recordings."""

    devices: dict[str, Device]
    wards: set[str]
    messages: int
    first_ns: int
    last_ns: int
    size: int
    refused: Tally
    trouble: list[str]

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return (self.last_ns - self.first_ns) * 1e-9


def survey(
    paths: Sequence[Path], tell: Tell = lambda _done, _of: None, wanted: Sequence[str] = (), *, keep: bool = False
) -> Survey:
    """Look through files; raises RecordingError for one that is none of ours. wanted: as of Contents; keep: the samples."""
    contents = Contents(paths, wanted, tell)
    devices: dict[str, Device] = {}
    wards: set[str] = set()
    messages = 0
    for key, said, _ in contents:
        messages += 1
        wards.add(key.ward)
        device = devices.setdefault(key.device, Device())
        if isinstance(said, SampleBatch):
            device.bridge = said.bridge
            device.boots.setdefault(said.boot, Boot(said.boot)).read(said, keep=keep)
        elif isinstance(said, CorrectedBatch):
            device.boots.setdefault(said.boot, Boot(said.boot)).rated(said, keep=keep)
        elif isinstance(said, DeviceInfo):
            device.infos[said.boot] = said
        elif isinstance(said, Calibration):
            device.calibrations[said.id or str(said.time_ns)] = said
        elif isinstance(said, Note):
            device.notes[said.time_ns, said.text] = said
    boots = [boot for device in devices.values() for boot in device.boots.values() if boot.samples]
    return Survey(
        devices=dict(sorted(devices.items())),
        wards=wards,
        messages=messages,
        first_ns=min((boot.first_ns for boot in boots), default=0),
        last_ns=max((boot.last_ns for boot in boots), default=0),
        size=contents.size,
        refused=contents.refused,
        trouble=contents.trouble,
    )
