"""What tracking costs: time for a sample and memory for a device, of many devices on one core. `make bench-tracking`."""

import sys
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from time import process_time

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from rich.console import Console

from bridge.wire.messages import SampleBatch
from estimator.gyro import PriorKnobs, uncalibrated
from estimator.loops.compiled import ready
from estimator.session import DeviceSession
from estimator.stillness import Stillness
from estimator.track.bias_filter import OWN
from estimator.track.gravity import SIZE
from estimator.track.tracker import Tracker, TrackKnobs
from tests.bench.side_by_side import arithmetic
from tests.sim.day import Day, simulate_day

Floats = NDArray[np.float64]

DEVICES, SECONDS, RATE_HZ, BATCH, BLOCK = 100, 120.0, 104.0, 10, 104
_GOAL_US, _GOAL_BYTES = 1.0, 500_000


class One:
    """A device as a session has it: windows, and the tracker behind them."""

    def __init__(self, *, history: int | None = 256) -> None:
        model = uncalibrated(PriorKnobs())
        self.stillness = Stillness()
        self.tracker = Tracker(TrackKnobs(history=history), 0.0, model, np.full(3, np.radians(5.0)))

    def take(self, rows: Floats) -> None:
        """Take rows of samples (n, 9), as a session's blocks are."""
        self.tracker.take(self.stillness.feed_rows(rows))


def rows_of(day: Day, *, aided: bool) -> Floats:
    """(n, 9) of all its samples, as a session has them."""
    accel = day.accel if aided else np.full_like(day.accel, np.nan)
    return np.column_stack([day.time_s, day.gyro, accel, np.zeros(len(accel)), day.temperature_c])


def run(days: list[Day], make: Callable[[], One], *, aided: bool) -> tuple[float, list[One]]:
    """CPU seconds for all samples of all devices, second by second, all devices back to back; and the devices."""
    devices = [make() for _ in range(DEVICES)]
    lives = [rows_of(day, aided=aided) for day in days]
    begun = process_time()
    for start in range(0, len(days[0].time_s), BLOCK):  # a session learns from blocks of a second
        for i, device in enumerate(devices):
            device.take(lives[i % len(lives)][start : start + BLOCK])
    return process_time() - begun, devices


def sessions(days: list[Day]) -> float:
    """CPU seconds for the same, of all that a session does: calibration looked for, rates corrected, past noted."""
    devices = [DeviceSession(f"d{i}") for i in range(DEVICES)]
    batches = [list(_batches(day)) for day in days]
    for i, device in enumerate(devices):
        device.begin_boot(1, float(batches[i % len(days)][0].device_time[0]), None)
    begun = process_time()
    for round_ in zip(*batches, strict=True):
        for i, device in enumerate(devices):
            device.handle(round_[i % len(days)])
    return process_time() - begun


def resting(days: list[Day]) -> float:
    """Which share of the seconds is a rest, to a tracker with an accelerometer."""
    rests = 0
    for day in days:
        one = One()
        for window in one.stillness.feed_rows(rows_of(day, aided=True)).each():
            receipts = one.tracker.take(window)
            rests += len({receipt.time for receipt in receipts if receipt.kind.startswith("zaru level")})
    return rests / (SECONDS * len(days))


def filter_alone(states: int, rows: Sequence[int], late: int, seconds: int = 2000) -> float:
    """CPU seconds for what filterpy itself does of a second: a step of time, evidence of so many rows each, and some late."""
    kf = KalmanFilter(dim_x=states, dim_z=3)
    F, Q = np.eye(states), 1e-9 * np.eye(states)
    kf.x, kf.M = np.zeros(states), np.zeros((states, late))
    now = [(np.zeros(m), np.eye(m), np.eye(m, states)) for m in rows]
    then = np.zeros(late), np.eye(late), np.eye(late, states)
    begun = process_time()
    for _ in range(seconds):
        kf.predict(F=F, Q=Q)
        for z, R, H in now:
            kf.update(z, R=R, H=H)
        if late:
            kf.update_correlated(then[0], R=then[1], H=then[2])
    return (process_time() - begun) / seconds


def alone(days: list[Day]) -> float:
    """CPU seconds a sample for the arithmetic alone, of all devices side by side."""
    n, seconds = round(RATE_HZ), round(SECONDS)

    def cut(columns: list[NDArray[np.float32]]) -> NDArray[np.float64]:
        each = [column[: seconds * n].astype(float).reshape(seconds, n, 3) for column in columns]
        return np.stack(each * (DEVICES // len(days)), axis=1)

    gyro, accel = cut([day.gyro for day in days]), cut([day.accel for day in days])
    return arithmetic(gyro, accel, RATE_HZ) / gyro[..., 0].size


def _batches(day: Day) -> Iterator[SampleBatch]:
    ticks = np.round(day.time_s * 1e6).astype(np.uint64)
    for start in range(0, len(ticks), BATCH):
        here = slice(start, start + BATCH)
        now_ns = int(ticks[start]) * 1000
        flags = np.zeros(len(ticks[here]), np.uint32)
        yield SampleBatch(
            "d", 1, start, now_ns, now_ns, 1e-6, 1.0, ticks[here], day.gyro[here], day.accel[here], None, flags
        )


def main() -> int:
    """Print what it costs; no verdict."""
    console = Console()
    days = [simulate_day(seed, SECONDS / 3600, RATE_HZ) for seed in range(10)]
    samples = DEVICES * len(days[0].time_s)
    ready()
    for name, aided in (("with accelerometer", True), ("gyro only", False)):
        spent, _ = run(days, One, aided=aided)
        console.print(f"{name}: {1e6 * spent / samples:.2f} µs a sample for {DEVICES} devices (goal {_GOAL_US:g})")
    steps = {
        name: 1e6 * filter_alone(states, rows, late) / RATE_HZ
        for name, states, rows, late in (
            ("moving, with accelerometer", SIZE, (3,), 0),
            ("at rest, with accelerometer", SIZE, (3, 2), 1),
            ("at rest, gyro only", OWN, (), 3),
        )
    }
    for name, spent in steps.items():
        console.print(f"limit, {name}: {spent:.2f} µs a sample are filterpy's own steps, once a second")
    least, share = 1e6 * alone(days), resting(days)
    both = share * steps["at rest, with accelerometer"] + (1 - share) * steps["moving, with accelerometer"]
    console.print(
        f"limit, with accelerometer: {least:.2f} µs more are the arithmetic of {DEVICES} devices side by side in arrays, "
        f"with nothing judged; {least + both:.2f} in all, {100 * share:.0f} % of these seconds being rest"
    )
    console.print(f"whole sessions, with accelerometer: {1e6 * sessions(days) / samples:.2f} µs a sample")
    rows = rows_of(simulate_day(0, 0.5, RATE_HZ), aided=True)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    one = One()
    for start in range(0, len(rows), BATCH):
        one.take(rows[start : start + BATCH])
    after, _ = tracemalloc.get_traced_memory()
    console.print(f"memory after half an hour: {(after - before) / 1e6:.2f} MB a device (goal {_GOAL_BYTES / 1e6:g})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
