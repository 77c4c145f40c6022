"""A stream of several boots as a bad network delivers it: with holes, sent twice, out of order; and what it truly is."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import CorrectedBatch, Quality, SampleFlag
from estimator.once import Event

Bytes = dict[tuple[str, int], tuple[bytes, ...]]
START_NS, PERIOD_US, LONGEST = 1_700_000_000_000_000_000, 10_000, 8


@dataclass(frozen=True, slots=True, eq=False)
class Boot:
    """All samples of one boot, one batch; and which of them ever reach the bus."""

    whole: CorrectedBatch
    there: NDArray[np.bool_]

    def part(self, start: int, end: int) -> CorrectedBatch:
        """Samples start to end of it, counted from its first, as a publisher sends them."""
        w, flags = self.whole, self.whole.flags[start:end].copy()
        return replace(
            w,
            sequence=w.sequence + start,
            start_time_ns=w.start_time_ns + int(w.ticks[start] - w.ticks[0]) * 1000,
            ticks=w.ticks[start:end],
            rate=w.rate[start:end],
            flags=flags,
        )

    def cut(self, rng: np.random.Generator, start: int, end: int) -> list[CorrectedBatch]:
        """What is there between two samples, in batches of any length, none across a hole."""
        found, at = [], start
        while at < end:
            until = min(end, at + int(rng.integers(1, LONGEST + 1)))
            run = self.there[at:until]
            if not run[0]:
                at += 1
                continue
            length = len(run) if run.all() else int(np.argmin(run))
            found.append(self.part(at, at + length))
            at += length
        return found


def make_boot(rng: np.random.Generator, device: str, number: int, n: int, first: int) -> Boot:
    """n samples of noise; a few holes, some of them told by a flag."""
    there = np.ones(n, np.bool_)
    flags = np.zeros(n, np.uint32)
    for _ in range(int(rng.integers(0, 4))):
        start = int(rng.integers(1, n - 1))
        end = min(n - 1, start + int(rng.integers(1, 6)))
        there[start:end] = False
        flags[end] = SampleFlag.AFTER_GAP * rng.integers(0, 2)
    whole = CorrectedBatch(
        device=device, boot=number, sequence=first, start_time_ns=START_NS + first * PERIOD_US * 1000,
        tick_period_s=1e-6, clock_rate=1.0, ticks=(np.arange(first, first + n) * PERIOD_US).astype(np.uint64),
        rate=rng.normal(size=(n, 3)).astype(np.float32), flags=flags, quality=Quality.GOOD,
        noise_std=np.ones(3, np.float32), bias_std=np.ones(3, np.float32), scale_std=np.ones(3, np.float32),
        bias=np.zeros(3, np.float32), calibration="c1", cross_std=np.ones(3, np.float32),
    )  # fmt: skip
    return Boot(whole, there)


def delivered(rng: np.random.Generator, boots: list[Boot], displaced: int) -> list[CorrectedBatch]:
    """All boots side by side; stretches sent again in other batches; each batch up to so many samples late."""
    sent: list[tuple[float, CorrectedBatch]] = []
    for boot in boots:
        n = len(boot.whole)
        batches = boot.cut(rng, 0, n)
        for _ in range(int(rng.integers(0, 3))):
            start = int(rng.integers(0, n))
            batches += boot.cut(rng, start, min(n, start + int(rng.integers(1, 60))))
        batches += [batches[i] for i in rng.integers(0, len(batches), int(rng.integers(0, 5)))]
        keys = np.array([b.sequence - boot.whole.sequence for b in batches]) + rng.uniform(0, displaced, len(batches))
        sent += zip(keys.tolist(), batches, strict=True)
    return [batch for _, batch in sorted(sent, key=lambda one: one[0])]


def expected(boots: list[Boot]) -> Bytes:
    """Every sample that is there once and in order, as bytes."""
    return {
        (boot.whole.device, boot.whole.boot): (
            (boot.whole.sequence + np.flatnonzero(boot.there)).tobytes(),
            boot.whole.ticks[boot.there].tobytes(),
            boot.whole.rate[boot.there].tobytes(),
            boot.whole.flags[boot.there].tobytes(),
            boot.whole.sample_time_ns[boot.there].tobytes(),
        )
        for boot in boots
    }


def given(events: list[Event]) -> Bytes:
    """The same of what a subscriber was given."""
    boots: dict[tuple[str, int], list[CorrectedBatch]] = {}
    for event in events:
        if isinstance(event, CorrectedBatch):
            boots.setdefault((event.device, event.boot), []).append(event)
    return {
        which: (
            np.concatenate([b.sequence + np.arange(len(b)) for b in batches]).tobytes(),
            np.concatenate([b.ticks for b in batches]).tobytes(),
            np.concatenate([b.rate for b in batches]).tobytes(),
            np.concatenate([b.flags for b in batches]).tobytes(),
            np.concatenate([b.sample_time_ns for b in batches]).tobytes(),
        )
        for which, batches in boots.items()
    }
