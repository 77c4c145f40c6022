"""Survey of recordings: devices, boots, rates, gaps, calibrations and notes; optionally with the samples."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from bridge.recording.contents import Tell, contents
from bridge.recording.sequence_tracker import SequenceTracker
from bridge.wire.messages import (
    Calibration,
    CorrectedBatch,
    DeviceInfo,
    Note,
    OrientationBatch,
    Placement,
    Quality,
    SampleBatch,
    Status,
)
from bridge.wire.refusal import Tally


@dataclass(slots=True)
class Boot:
    """Summary of one boot of a device: counts of samples, gaps and repeats, and times of its first and last sample.

    boot: 64-bit boot number. first_ns, last_ns: host times, ns since the Unix epoch. missing: number of samples lost in
    gaps. repeated: number of samples received again. device_s: time from first to last sample by the device's clock, s.
    kept: batches of readings, each sample once, in parts that begin where sequence numbers start over. rates,
    attitudes: batches of corrected rates and orientations as received.
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
    attitudes: list[OrientationBatch] = field(default_factory=list)
    _readings: SequenceTracker = field(default_factory=SequenceTracker)
    _rated: SequenceTracker = field(default_factory=SequenceTracker)
    _runs: list[tuple[int, int, str]] = field(default_factory=list)  # first number, the one after the last, quality

    @property
    def rate_hz(self) -> float:
        """Sampling rate by the device's clock, Hz, counting missing samples too; 0 if unknown."""
        return (self.samples + self.missing - 1) / self.device_s if self.device_s > 0 else 0.0

    @property
    def corrected(self) -> Counter[str]:
        """Number of corrected samples by name of their quality, such as GOOD.

        Each sample counts once. Samples before the first recorded reading do not count.
        """
        found = Counter[str]()
        for first, end, quality in self._runs if self.samples else ():
            found[quality] += max(0, end - max(first, self.first))
        return +found

    def read(self, batch: SampleBatch, *, keep: bool) -> None:
        """Count the new samples, repeats and gaps of a batch of readings. keep: True stores the new samples in `kept`."""
        skip, missing, anew, step = self._readings.follow(batch)
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
        """Count the new samples of a batch of corrected rates by quality. keep: True stores the batch in `rates`."""
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
    """Content of recordings about one device: infos, boots, calibrations, notes and placements.

    bridge: id of its bridge. infos, boots: by boot number. calibrations: by id. notes: by time (ns since the Unix
    epoch) and text. placements: by begin, ns since the Unix epoch.
    """

    bridge: str = ""
    infos: dict[int, DeviceInfo] = field(default_factory=dict)
    boots: dict[int, Boot] = field(default_factory=dict)
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    notes: dict[tuple[int, str], Note] = field(default_factory=dict)
    placements: dict[int, Placement] = field(default_factory=dict)  # by since_ns

    def wear(self, status: Status) -> None:
        """Store the placement (body segment and wearer) that a status message states, unless it is stored already.

        A status without a placement ends the placement before it. A placement may lack its begin time. It then
        begins at the time of the status, or at 0 if it is the first placement of the recording.
        """
        last, one = next(reversed(self.placements.values()), None), status.placement
        if one is None and last is not None:
            one = Placement()
        if one is None or (not one.since_ns and last is not None and str(one) == str(last)):
            return
        if not one.since_ns:
            one = replace(one, since_ns=status.time_ns if self.placements else 0)
        self.placements[one.since_ns] = one

    def worn(self, first_ns: int, last_ns: int) -> tuple[Placement, ...]:
        """Return the placements that held at some time between two host times, in order.

        first_ns, last_ns: ns since the Unix epoch.
        """
        found = sorted(self.placements.items())
        ends = [*(since_ns for since_ns, _ in found[1:]), last_ns + 1]
        return tuple(
            one
            for (since_ns, one), end_ns in zip(found, ends, strict=False)
            if since_ns <= last_ns and end_ns > first_ns
        )

    @property
    def info(self) -> DeviceInfo | None:
        """Device info of the last boot; None if no info was recorded."""
        return next(reversed(self.infos.values()), None)


@dataclass(slots=True)
class Survey:
    """Summary of recordings: devices by id, wards, number of messages, and size in bytes.

    first_ns, last_ns: host times of the first and last sample, ns since the Unix epoch; 0 without samples.
    refused: number of messages that could not be decoded, by reason. trouble: faults of the files, as sentences for the
    user.
    """

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
        """Duration from the first sample to the last, s."""
        return (self.last_ns - self.first_ns) * 1e-9


def survey(
    paths: Sequence[Path], tell: Tell = lambda _done, _of: None, wanted: Sequence[str] = (), *, keep: bool = False
) -> Survey:
    """Survey a ward's recordings: devices, boots, rates, gaps, calibrations and notes.

    tell(done, total): called with the number of bytes read so far, and of all bytes.
    wanted: kinds of message to read, by the first word of their topic; empty for all. keep: True stores
    the samples. Raises RecordingError for a file that is not a recording of a ward.
    """
    refused, trouble = Tally(), list[str]()
    sizes = [path.stat().st_size for path in paths if path.is_file()]
    devices: dict[str, Device] = {}
    wards: set[str] = set()
    messages = 0
    for key, said in contents(paths, wanted, tell, refused, trouble):
        messages += 1
        wards.add(key.ward)
        device = devices.setdefault(key.device, Device())
        if isinstance(said, SampleBatch):
            device.bridge = said.bridge
            device.boots.setdefault(said.boot, Boot(said.boot)).read(said, keep=keep)
        elif isinstance(said, CorrectedBatch):
            device.boots.setdefault(said.boot, Boot(said.boot)).rated(said, keep=keep)
        elif isinstance(said, OrientationBatch):
            if keep:
                device.boots.setdefault(said.boot, Boot(said.boot)).attitudes.append(said)
        elif isinstance(said, DeviceInfo):
            device.infos[said.boot] = said
        elif isinstance(said, Calibration):
            device.calibrations[said.id or str(said.time_ns)] = said
        elif isinstance(said, Note):
            device.notes[said.time_ns, said.text] = said
        elif isinstance(said, Status):
            device.wear(said)
    boots = [boot for device in devices.values() for boot in device.boots.values() if boot.samples]
    return Survey(
        devices=dict(sorted(devices.items())),
        wards=wards,
        messages=messages,
        first_ns=min((boot.first_ns for boot in boots), default=0),
        last_ns=max((boot.last_ns for boot in boots), default=0),
        size=sum(sizes),
        refused=refused,
        trouble=trouble,
    )
