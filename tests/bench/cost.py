"""What tracking costs: processor time a device and second, and memory a device, of many devices on one core."""

import sys
import tracemalloc
from collections.abc import Callable
from time import process_time

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from estimator.geometry.gyro_model import PriorKnobs, uncalibrated
from estimator.kernels.compiled import ready
from estimator.stillness.detector import Stillness
from estimator.tracking.tracker import Tracker, TrackKnobs
from tests.sim.day import Day, simulate_day

Floats = NDArray[np.float64]

DEVICES, SECONDS, RATE_HZ, BATCH, BLOCK = 100, 120.0, 104.0, 10, 104
_GOAL_US, _GOAL_BYTES = 80.0, 500_000


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


def main() -> int:
    """Print what it costs; no verdict."""
    console = Console()
    days = [simulate_day(seed, SECONDS / 3600, RATE_HZ) for seed in range(10)]
    ready()
    for name, aided in (("with accelerometer", True), ("gyro only", False)):
        spent, _ = run(days, One, aided=aided)
        console.print(f"{name}: {1e6 * spent / (DEVICES * SECONDS):.0f} µs a device and second (goal {_GOAL_US:g})")
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
