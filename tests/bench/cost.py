"""What learning costs: processor time a device and second, and memory a device, of many devices on one core.

The devices are those of tests/bench/load: worn and not calibrated. Each message goes through a session, as in the service.
"""

import argparse
import sys
import tracemalloc
from time import process_time
from typing import NamedTuple

import numpy as np
from rich.console import Console

from bridge.bus.contract import Message
from estimator.device.batch_correction import Cut, correct
from estimator.device.orientation import oriented
from estimator.device.session import DeviceSession
from estimator.geometry.gyro_model import PriorKnobs, uncalibrated
from estimator.kernels.compiled import ready
from estimator.samples.sample_buffer import ACCEL, CELSIUS, GYRO, TIME, Samples
from estimator.service.decode import decode
from estimator.stillness.detector import Stillness
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.tracker import Tracker
from tests.bench.load.stream import Fleet
from tests.estimator.tracking.worn import learnt
from tests.sim.day import simulate_day

RATE_HZ, BATCH = 104.0, 10
_GOAL_US, _GOAL_BYTES = 80.0, 500_000


class Spent(NamedTuple):
    """Processor time, s, of decoding and correcting, of learning, and of orientation."""

    corrected: float
    learnt: float
    turned: float


class Ward:
    """Sessions of the devices of a fleet."""

    def __init__(self, devices: int) -> None:
        self.fleet = Fleet(devices, RATE_HZ, BATCH, seed=1)
        self.sessions: list[DeviceSession] = []
        self._rounds = 0

    def lives(self, seconds: float, *, turning: bool = False) -> Spent:
        """What it costs to live on for so long; turning: with the orientation of all devices."""
        corrected = learnt = turned = 0.0
        for number in range(self._rounds, self._rounds + round(seconds / self.fleet.period_s)):
            time_ns = 10**18 + round(number * self.fleet.period_s * 1e9)
            messages = [Message(self.fleet.keys[i], data) for i, data in self.fleet.round(number, time_ns)]
            begun, cuts = process_time(), list[Cut]()
            for i, batch in enumerate(decode(messages)):
                assert isinstance(batch, Samples)
                if i == len(self.sessions):
                    self.sessions.append(DeviceSession(batch.device))
                    self.sessions[i].begin_boot(batch.boot, batch.first_s, None)
                self.sessions[i].take(batch, cuts)
            correct(cuts)
            after_correction = process_time()
            if turning:
                attitudes = {session.device: session.attitude for session in self.sessions}
                oriented([(attitude, cut) for cut in cuts if (attitude := attitudes[cut.samples.device])])
            after_turning = process_time()
            for session in self.sessions:
                if session.to_learn:
                    session.learn()
            corrected += after_correction - begun
            turned += after_turning - after_correction
            learnt += process_time() - after_turning
            self._rounds = number + 1
        return Spent(corrected, learnt, turned)


def memory() -> int:
    """Bytes that half an hour of a device leaves."""
    day = simulate_day(0, 0.5, RATE_HZ)
    rows = np.column_stack([day.time_s, day.gyro, day.accel, np.zeros(len(day.accel)), day.temperature_c])
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    stillness = Stillness()
    tracker = Tracker(TrackKnobs(), 0.0, uncalibrated(PriorKnobs()), np.full(3, np.radians(5.0)))
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
    console, ward = Console(), Ward(wanted.devices)
    each = 1e6 / (wanted.devices * wanted.seconds)
    ready()
    ward.lives(10.0)  # the first rests and seconds, and filterpy's import
    plain = ward.lives(wanted.seconds)
    for session in ward.sessions:
        session.orient()
    turning = ward.lives(wanted.seconds, turning=True)
    console.print(f"decoding and correcting  {each * plain.corrected:6.1f} µs a device and second")
    console.print(f"learning, all of it      {each * plain.learnt:6.1f} µs (goal of the tracker: {_GOAL_US:g})")
    share = turning.turned / (turning.corrected + turning.learnt)
    console.print(f"orientation of all       {each * turning.turned:6.1f} µs, {share:.1%} of the rest")
    console.print(f"memory after half an hour: {memory() / 1e6:.2f} MB a device (goal {_GOAL_BYTES / 1e6:g})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
