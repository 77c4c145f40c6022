"""A person who follows the guide, and now and then does something else; says where guide and hand contradict each other.

The hand lives in the room: turns are about the vertical, along the edge of the table, or across it. How the device's axes lie in
the room is the hand's own business. `python -m tests.estimator.guide.random_hand --sequences 200`
"""

import argparse
import sys
from collections import deque
from collections.abc import Iterator

import numpy as np

from bridge.sim.imu_errors import DEMO_SPEC, ImuErrorModel
from bridge.sim.motion import Motion, Piece, Still, Turn
from bridge.sim.quaternion import Array, conjugate, from_rotvec, multiply
from bridge.wire.messages import SampleBatch
from estimator.config.device_settings import Treatment
from estimator.device.session import DeviceSession
from estimator.guide.guide import Guide
from estimator.guide.steps import Instruction, Step
from tests.estimator.stream import NAME, feed

RATE_HZ, BATCH = 104.0, 13
#: directions in the room by picture: the vertical, along the edge, across it
ROOM = {"flat": np.array([0.0, 0.0, 1.0]), "along": np.array([1.0, 0.0, 0.0]), "across": np.array([0.0, 1.0, 0.0])}
BAD = ("short", "long", "back", "diagonal", "tilted", "slow")
NEUTRAL = ("lay", "nudge", "other")


class Bench:
    """One device at the edge of a table, its session and its guide; time goes on as the hand says."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        quarter = np.pi / 2
        first = multiply(
            from_rotvec(quarter * self.rng.integers(4) * ROOM["flat"][None]),
            from_rotvec(quarter * self.rng.integers(4) * ROOM[str(self.rng.choice(["along", "across"]))][None]),
        )
        self.attitude: Array = first[0]
        #: the direction about which a device leans that was put down badly
        self.leans: Array | None = None
        self._due: deque[Piece] = deque()
        self._motion, self._sensor = Motion(self._pieces(), self.attitude), ImuErrorModel(DEMO_SPEC, self.rng)
        knobs = Treatment().of(NAME)
        self.session, self.guide, self._n = DeviceSession(NAME, knobs), Guide(knobs.method, knobs.prior.noise_std), 0

    def _pieces(self) -> Iterator[Piece]:
        while True:
            yield self._due.popleft() if self._due else Still(BATCH / RATE_HZ / 2)

    def body(self, direction: Array) -> Array:
        """A direction of the room in axes of the device."""
        turned = multiply(multiply(conjugate(self.attitude[None]), np.array([[0.0, *direction]])), self.attitude[None])
        return np.asarray(turned[0, 1:])

    def move(self, direction: Array, *angles_deg: float, seconds: float, miss: Array | None = None) -> None:
        """Turn about a direction of the room by these angles, one after the other, and end off by `miss`, rad, in the room."""
        rng, axis = self.rng, self.body(direction)
        for angle in angles_deg:
            across = np.radians(rng.uniform(-2, 2, 3))
            wobble = across - axis * (across @ axis)
            offset = np.radians(0.2) * rng.normal(size=3) + (0 if miss is None else self.body(miss))
            share = seconds / len(angles_deg)
            piece = Turn(share, axis, float(np.radians(angle)), np.array([[0.0, share, 1.0]]), wobble[None], offset)
            self._due.append(piece)
            self.attitude = multiply(self.attitude[None], piece.attitude(np.array([share])))[0]
        self.wait(seconds)

    def wait(self, seconds: float) -> Instruction:
        """Let the time pass, and return what is told at its end."""
        for _ in range(round(seconds * RATE_HZ / BATCH) + 1):
            feed(self.session, [batch := self._next()])
            self.guide.take_samples(batch)
            self.guide.take_status(self.session.status(batch.receive_time_ns))
        return self.guide.told()

    def _next(self) -> SampleBatch:
        ticks = np.round(np.arange(self._n + 1, self._n + BATCH + 1) / (RATE_HZ * 1e-6)).astype(np.uint64)
        read = self._sensor.read(self._motion.advance(ticks.astype(np.float64) * 1e-6))
        gyro, accel, celsius = (
            np.asarray(one, np.float32).reshape(BATCH, -1) for one in (read.gyro, read.accel, read.temperature_c)
        )
        at_ns, flags = 10**18 + int(ticks[0]) * 1000, np.zeros(BATCH, np.uint32)
        self._n += BATCH
        return SampleBatch(NAME, 1, self._n - BATCH, at_ns, at_ns, 1e-6, 1.0, ticks, gyro, accel, celsius[:, 0], flags)


def sequence(seed: int, most_bad: int = 6) -> list[str]:
    """Play one sequence to its end; returns what the guide said that the hand knows to be wrong."""
    bench, found, history = Bench(seed), list[str](), list[str]()
    rng, told = bench.rng, bench.wait(6.0)
    bad_left, good, others = most_bad, 0, 0
    while told.step is Step.TURN:
        kind = str(rng.choice([*BAD, *NEUTRAL])) if bad_left and rng.random() < 0.45 else "good"
        bad_left -= kind != "good"
        good, others = good + (kind == "good"), others + (kind == "other")
        done, picture = set(told.done), str(told.picture)
        history.append(f"{kind} at {picture}")
        turned = _do(bench, kind, picture)
        told = bench.wait(rng.uniform(5.0, 6.5))
        over = told.step is Step.DONE
        axis = {int(np.argmax(np.abs(turned)))}
        if kind in ("good", "other") and (told.wrong or not (over or axis <= set(told.done))):
            found.append("was told that right was wrong")
        if kind in ("lay", "nudge") and (told.wrong or set(told.done) != done):
            found.append("was told that a device laid down otherwise was wrong")
        if kind in BAD and (over or not told.wrong or set(told.done) != done):
            found.append("was told that wrong was right")
        if bench.leans is not None and not over:  # it was said that it came back tilted
            bench.move(bench.leans, -12, seconds=1.0)
            bench.leans, told = None, bench.wait(5.0)
        if over or found or good > 4 + others:
            break
    if not found and told.step is not Step.DONE:
        found.append(f"was led nowhere: {told.step}")
    return [f"seed {seed}: {what}: {', '.join(history)}: {[one.code for one in told.wrong]}" for what in found]


def _do(bench: Bench, kind: str, picture: str) -> Array:
    """Move as a hand does that means well or not; returns the direction of the turn in axes of the device at its begin."""
    rng = bench.rng
    way, sign, seconds = ROOM[picture], float(rng.choice([-1, 1])), float(rng.uniform(3.5, 5.0))
    level = [ROOM["along"], ROOM["across"]]
    any_level = level[rng.integers(2)]
    axis = bench.body(way)
    match kind:
        case "good":
            bench.move(way, sign * 360, seconds=seconds)
        case "other":
            way = [one for name, one in ROOM.items() if name != picture][rng.integers(2)]
            axis = bench.body(way)
            bench.move(way, sign * 360, seconds=seconds)
        case (
            "short"
        ):  # of 270° about the vertical nobody can say before the other turns that it is no gyro that reads low
            bench.move(way, sign * float(rng.choice([180, 180 if picture == "flat" else 270])), seconds=seconds)
        case "long":
            bench.move(way, sign * float(rng.choice([720 if picture == "flat" else 540, 720])), seconds=1.6 * seconds)
        case "back":
            bench.move(way, sign * 200, -sign * 200, seconds=seconds)
        case "diagonal":
            bench.move((ROOM["flat"] + any_level) / np.sqrt(2), sign * 360, seconds=seconds)
        case "slow":
            bench.move(way, sign * 360, seconds=18.0)
        case "tilted":
            bench.move(way, sign * 360, seconds=seconds, miss=np.radians(12) * any_level)
            bench.leans = any_level
        case "nudge":
            bench.move(any_level, 8, -8, seconds=1.5)
        case "lay":
            bench.move(any_level, sign * 90, seconds=1.5)
    return axis


def main() -> int:
    """Play many sequences; exit code 1 if there is a contradiction."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sequences", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    found = [words for seed in range(given.first, given.first + given.sequences) for words in sequence(seed)]
    print(*found, f"{given.sequences} sequences, {len(found)} contradictions", sep="\n")  # noqa: T201
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
