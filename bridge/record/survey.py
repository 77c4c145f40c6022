"""`truerate recording info`: who is in recordings, from when to when, how fast, with which gaps; calibrations and notes."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bridge.record.contents import Contents, Tell
from bridge.record.numbering import Numbering
from bridge.wire.messages import Calibration, CorrectedBatch, DeviceInfo, Note, Quality, SampleBatch
from bridge.wire.refusal import Tally


@dataclass(slots=True)
class Boot:
    """One boot of a device: host times of its first and last sample, samples, and what is missing between them."""

    boot: int
    first_ns: int = 0
    last_ns: int = 0
    samples: int = 0
    missing: int = 0
    gaps: int = 0
    repeated: int = 0
    device_s: float = 0.0
    corrected: Counter[str] = field(default_factory=Counter)  # samples by quality
    numbering: Numbering = field(default_factory=Numbering)

    @property
    def rate_hz(self) -> float:
        """Samples a device second, missing ones included; 0 when unknown."""
        return (self.samples + self.missing - 1) / self.device_s if self.device_s > 0 else 0.0


@dataclass(slots=True)
class Device:
    """What is known of a device: its boots by number, calibrations and notes in order."""

    info: DeviceInfo | None = None
    boots: dict[int, Boot] = field(default_factory=dict)
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    notes: dict[tuple[int, str], Note] = field(default_factory=dict)


@dataclass(slots=True)
class Survey:
    """Everything of some files."""

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


def survey(paths: Sequence[Path], tell: Tell = lambda _done, _of: None) -> Survey:
    """Look through files; raises RecordingError for one that is none of ours."""
    contents = Contents(paths, tell=tell)
    devices: dict[str, Device] = {}
    wards: set[str] = set()
    messages = 0
    for key, said, _ in contents:
        messages += 1
        wards.add(key.ward)
        device = devices.setdefault(key.device, Device())
        if isinstance(said, SampleBatch):
            _samples(device.boots.setdefault(said.boot, Boot(said.boot)), said)
        elif isinstance(said, CorrectedBatch):
            device.boots.setdefault(said.boot, Boot(said.boot)).corrected[Quality(said.quality).name] += len(said)
        elif isinstance(said, DeviceInfo):
            device.info = said if said.boot or device.info is None else device.info
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


def _samples(boot: Boot, batch: SampleBatch) -> None:
    skip, missing, anew, step = boot.numbering.follow(batch)
    boot.repeated += skip
    if skip == len(batch):
        return
    times = batch.sample_time_ns
    if anew:
        boot.gaps += bool(boot.samples)
    else:
        boot.missing += missing
        boot.gaps += bool(missing)
        boot.device_s += step * batch.tick_period_s
    boot.device_s += float(batch.ticks[-1] - batch.ticks[skip]) * batch.tick_period_s
    boot.first_ns = min(boot.first_ns or int(times[skip]), int(times[skip]))
    boot.last_ns = max(boot.last_ns, int(times[-1]))
    boot.samples += len(batch) - skip
