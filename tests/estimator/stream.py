"""What a simulated device sends, cut into batches at will, with the truth beside it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bridge.recording import Recording
from bridge.sim.imu_errors import ImuErrorModel, ImuSpec, Truth
from bridge.sim.motion import Motion, Piece, Still
from bridge.sim.motion_scripts import SessionPlan, TurnPlan, flat, session
from bridge.wire.messages import BootCause, Calibration, CorrectedBatch, DeviceInfo, SampleBatch
from estimator.device.batch_correction import Cut, batch_of, correct
from estimator.device.correction import Correction
from estimator.device.orientation import OrientedCut, oriented
from estimator.device.outcome import Outcome
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.session import DeviceSession
from estimator.samples.sample_buffer import Samples

Floats = NDArray[np.float64]
NAME = "chest"


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """n samples of one boot and what is true of them: ticks of 1 µs, gyro, accel, temperature; rate, bias and attitude."""

    ticks: NDArray[np.int64]
    gyro: Floats
    accel: Floats
    temperature_c: Floats
    rate: Floats
    bias: Floats
    truth: Truth
    rate_hz: float
    attitude: Floats = field(default_factory=lambda: np.zeros((0, 4)))

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def time(self) -> Floats:
        return np.asarray(self.ticks * 1e-6, np.float64)

    def part(self, start: int, end: int) -> "Stream":
        return self.only(slice(start, end))

    def only(self, cut: slice | NDArray[np.int64]) -> "Stream":
        """Some of the samples."""
        return replace(
            self,
            ticks=self.ticks[cut],
            gyro=self.gyro[cut],
            accel=self.accel[cut],
            temperature_c=self.temperature_c[cut],
            rate=self.rate[cut],
            bias=self.bias[cut],
            attitude=self.attitude[cut] if len(self.attitude) else self.attitude,
        )

    def at(self, time_s: float) -> int:
        """The first sample at or after a time."""
        return int(np.searchsorted(self.time, time_s))

    def recording(self, *, accel: bool = True) -> Recording:
        return Recording(self.time, self.gyro, self.accel if accel else None, None, self.rate_hz, NAME)

    def batches(
        self, edges: Sequence[int] | None = None, *, boot: int = 1, first: int = 0, accel: bool = True
    ) -> list[SampleBatch]:
        """The stream cut before each of the edges (default: every ten samples)."""
        edges = list(range(10, len(self), 10)) if edges is None else list(edges)
        bounds = sorted({0, *edges, len(self)})
        return [self._batch(a, b, boot, first + a, accel=accel) for a, b in pairwise(bounds)]

    def _batch(self, start: int, end: int, boot: int, sequence: int, *, accel: bool) -> SampleBatch:
        cut = slice(start, end)
        now_ns = 1_700_000_000_000_000_000 + int(self.ticks[start]) * 1000
        return SampleBatch(
            device=NAME,
            boot=boot,
            sequence=sequence,
            receive_time_ns=now_ns,
            start_time_ns=now_ns,
            tick_period_s=1e-6,
            clock_rate=1.0,
            ticks=self.ticks[cut].astype(np.uint64),
            gyro=self.gyro[cut].astype(np.float32),
            accel=self.accel[cut].astype(np.float32) if accel else None,
            temperature_c=self.temperature_c[cut].astype(np.float32),
            flags=np.zeros(end - start, np.uint32),
        )


def stream(
    pieces: Iterable[Piece],
    duration_s: float,
    *,
    seed: int = 0,
    spec: ImuSpec | None = None,
    rate_hz: float = 104.0,
    attitude: Floats | None = None,
) -> Stream:
    """What a device that lives through these pieces sends; attitude (4,) is its first, flat when None."""
    rng = np.random.default_rng(seed)
    ticks = np.round(np.arange(1, int(duration_s * rate_hz) + 1) / (rate_hz * 1e-6)).astype(np.int64)
    motion = Motion(pieces, flat(rng) if attitude is None else attitude).advance(np.asarray(ticks * 1e-6, np.float64))
    sensor = ImuErrorModel(spec or ImuSpec(), rng)
    read = sensor.read(motion)
    return Stream(
        ticks, read.gyro, read.accel, read.temperature_c, motion.rate, read.bias, sensor.truth, rate_hz, motion.attitude
    )


def calibration(
    *turns: TurnPlan,
    seed: int = 0,
    spec: ImuSpec | None = None,
    rate_hz: float = 104.0,
    before_s: float = 1.5,
    after: Sequence[Piece] = (),
    plan: SessionPlan | None = None,
) -> Stream:
    """A device that boots, is turned (by default once about each axis), and then lives through `after`."""
    plan = plan or SessionPlan(turns=turns or (TurnPlan(0), TurnPlan(1, -360.0), TurnPlan(2)), turn_s=(4.0, 5.0))
    pieces = [Still(before_s), *session(np.random.default_rng(seed), plan), *after]
    return stream(pieces, sum(p.duration_s for p in pieces), seed=seed, spec=spec, rate_hz=rate_hz)


def info(boot: int = 1, *, firmware: str = "1.0", model: str = "m") -> DeviceInfo:
    return DeviceInfo(
        NAME, "bridge", boot, BootCause.POWER_UP, model, firmware, "native", "p", 104.0, 104.0, 8.7, True, True, 1
    )  # fmt: skip


@dataclass(slots=True)
class Fed(Outcome):
    """What several batches led to, together: also the corrected ones, and their attitudes where they are wanted."""

    corrected: list[CorrectedBatch] = field(default_factory=list)
    oriented: list[OrientedCut] = field(default_factory=list)

    def add(self, outcome: Outcome) -> None:
        self.calibrations += outcome.calibrations
        self.revisions += outcome.revisions
        self.seconds += outcome.seconds
        self.changed |= outcome.changed
        self.said += outcome.said

    @property
    def calibration(self) -> Calibration | None:
        """The latest."""
        return next(reversed(self.calibrations), None)


def handle(device: DeviceSession, batch: SampleBatch) -> Fed:
    """A batch of the present boot is corrected and learnt from at once."""
    fed, cuts = Fed(), list[Cut]()
    if (outcome := device.take(Samples.of(batch), cuts)) is not None:
        fed.add(outcome)
    fed.corrected = [batch_of(cut, rates) for cut, rates in zip(cuts, correct(cuts), strict=True)]
    if device.attitude is not None:
        fed.oriented = oriented([(device.attitude, cut) for cut in cuts], every=True)
    fed.add(device.learn())
    return fed


def feed(device: DeviceSession, batches: Iterable[SampleBatch], remembered: PriorKnowledge | None = None) -> Fed:
    """As the service does: a new boot is begun, then the batch is handled. All that came of it in one Outcome."""
    total = Fed()
    for batch in batches:
        if device.sequence.is_new_boot(batch.boot):
            total.add(device.begin_boot(batch.boot, float(batch.device_time[0]), remembered))
        total.add(fed := handle(device, batch))
        total.corrected += fed.corrected
    return total


def corrected_by(correction: Correction, batch: SampleBatch, first: int = 0, end: int | None = None) -> CorrectedBatch:
    """Samples first to end of a batch, as they are published."""
    cut = Cut(Samples.of(batch), correction, first, len(batch) if end is None else end)
    return batch_of(cut, *correct([cut]))


def rates(corrected: Iterable[CorrectedBatch]) -> NDArray[np.float32]:
    return np.concatenate([batch.rate for batch in corrected])
