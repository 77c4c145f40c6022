"""What learning costs: processor time a device and second by stage, and memory a device, of many devices on one core.

The devices are those of tests/bench/load: worn and not calibrated. Each message goes through a session, as in the service.
"""

import argparse
import sys
import tracemalloc
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from time import process_time
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bridge.bus.contract import Message
from estimator.device.batch_correction import Cut, correct
from estimator.device.boot_estimation import BootEstimation
from estimator.device.calibration_progress import CalibrationProgress
from estimator.device.orientation import oriented
from estimator.device.session import DeviceSession
from estimator.geometry.gyro_model import PriorKnobs, uncalibrated
from estimator.kernels.compiled import ready
from estimator.orientation.attitude import Attitude
from estimator.samples.sample_buffer import ACCEL, CELSIUS, GYRO, TIME, Samples
from estimator.service.decode import decode
from estimator.stillness.detector import Stillness
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.seconds import Seconds
from estimator.tracking.smoother import History
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.tracker import Tracker
from tests.bench.load.stream import Fleet
from tests.estimator.tracking.worn import learnt
from tests.sim.day import Day, simulate_day

Floats = NDArray[np.float64]

RATE_HZ, BATCH = 104.0, 10
_GOAL_US, _GOAL_BYTES = 80.0, 500_000
#: names of stages, and the methods that each spends its time in
STAGES: dict[str, tuple[type, tuple[str, ...]]] = {
    "windows and stillness": (Stillness, ("take",)),
    "calibration": (CalibrationProgress, ("add", "judge")),
    "seconds": (Seconds, ("take",)),
    "tracker, the rest of it": (Tracker, ("learn",)),
    "filter, predict": (BiasFilter, ("predict",)),
    "filter, update": (BiasFilter, ("update", "update_both", "update_late")),
    "smoother's history": (History, ("add",)),
    "correction": (BootEstimation, ("correction",)),
}


@contextmanager
def staged(spent: dict[str, float]) -> Iterator[None]:
    """Count the seconds of each stage in `spent`, without those of the stages that it calls."""
    running: list[float] = []

    def timed(stage: str, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **named: Any) -> Any:
            begun = process_time()
            running.append(0.0)
            try:
                return method(*args, **named)
            finally:
                all_of_it = process_time() - begun
                spent[stage] += all_of_it - running.pop()
                if running:
                    running[-1] += all_of_it

        return call

    with ExitStack() as patches:
        for stage, (owner, methods) in STAGES.items():
            for name in methods:
                patches.enter_context(patch.object(owner, name, timed(stage, getattr(owner, name))))
        yield


class Ward:
    """Sessions of the devices of a fleet."""

    def __init__(self, devices: int) -> None:
        self.fleet = Fleet(devices, RATE_HZ, BATCH, seed=1)
        self.sessions: list[DeviceSession] = []
        self._rounds = 0

    def lives(self, seconds: float) -> tuple[float, float]:
        """Processor time, s, of taking samples and of learning."""
        took = learnt = 0.0
        for number in range(self._rounds, self._rounds + round(seconds / self.fleet.period_s)):
            time_ns = 10**18 + round(number * self.fleet.period_s * 1e9)
            batches = decode([Message(self.fleet.keys[i], data) for i, data in self.fleet.round(number, time_ns)])
            begun, cuts = process_time(), list[Cut]()
            for i, batch in enumerate(batches):
                assert isinstance(batch, Samples)
                if i == len(self.sessions):
                    self.sessions.append(DeviceSession(batch.device))
                    self.sessions[i].begin_boot(batch.boot, batch.first_s, None)
                self.sessions[i].take(batch, cuts)
            between = process_time()
            for session in self.sessions:
                if session.to_learn:
                    session.learn()
            took, learnt = took + between - begun, learnt + process_time() - between
            self._rounds = number + 1
        return took, learnt

    def turns(self, seconds: float) -> tuple[float, float]:
        """Processor time, s, of decoding, correcting and learning, and of the orientation of all devices beside it."""
        for session in self.sessions:
            session.orient()
        spent = [0.0, 0.0]
        for number in range(self._rounds, self._rounds + round(seconds / self.fleet.period_s)):
            time_ns = 10**18 + round(number * self.fleet.period_s * 1e9)
            messages = [Message(self.fleet.keys[i], data) for i, data in self.fleet.round(number, time_ns)]
            begun, cuts, due = process_time(), list[Cut](), list[tuple[Attitude, Cut]]()
            for session, batch in zip(self.sessions, decode(messages), strict=True):
                assert isinstance(batch, Samples)
                session.take(batch, cuts)
            correct(cuts)
            between = process_time()
            attitudes = {session.device: session.attitude for session in self.sessions}
            for cut in cuts:
                attitude = attitudes[cut.samples.device]
                assert attitude is not None
                due.append((attitude, cut))
            oriented(due)
            after = process_time()
            for session in self.sessions:
                if session.to_learn:
                    session.learn()
            spent[0] += between - begun + process_time() - after
            spent[1] += after - between
            self._rounds = number + 1
        return spent[0], spent[1]


def rows_of(day: Day) -> Floats:
    """(n, 9) of all its samples, as a session has them."""
    return np.column_stack([day.time_s, day.gyro, day.accel, np.zeros(len(day.accel)), day.temperature_c])


def memory() -> int:
    """Bytes that half an hour of a device leaves."""
    rows = rows_of(simulate_day(0, 0.5, RATE_HZ))
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    stillness, tracker = (
        Stillness(),
        Tracker(TrackKnobs(), 0.0, uncalibrated(PriorKnobs()), np.full(3, np.radians(5.0))),
    )
    for start in range(0, len(rows), BATCH):
        part = rows[start : start + BATCH]
        list(learnt(tracker, stillness.feed(part[:, TIME], part[:, GYRO], part[:, ACCEL], celsius=part[:, CELSIUS])))
    after, _ = tracemalloc.get_traced_memory()
    return after - before


def main() -> int:
    """Print what it costs; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--devices", type=int, default=200)
    asked.add_argument("--seconds", type=float, default=20.0)
    wanted, _ = asked.parse_known_args()  # --hours and --days are for those beside it
    console, ward, spent = Console(), Ward(wanted.devices), defaultdict[str, float](float)
    each = 1e6 / (wanted.devices * wanted.seconds)
    ready()
    ward.lives(10.0)  # the first rests and seconds, and filterpy's import
    took, learnt = ward.lives(wanted.seconds)
    with staged(spent):
        ward.lives(wanted.seconds)
    for stage in STAGES:
        console.print(f"{stage:24} {each * spent[stage]:6.1f} µs a device and second")
    console.print(f"taking samples           {each * took:6.1f} µs")
    console.print(f"learning, all of it      {each * learnt:6.1f} µs (goal of the tracker: {_GOAL_US:g})")
    whole, turned = ward.turns(wanted.seconds)
    console.print(
        f"orientation of all       {each * turned:6.1f} µs, {turned / whole:.1%} of decoding, correcting and learning"
    )
    console.print(f"memory after half an hour: {memory() / 1e6:.2f} MB a device (goal {_GOAL_BYTES / 1e6:g})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
