"""Estimators killed at random moments under load, and what each restart went on with. Real processes, router and store.

Steady devices live in the bridge and are calibrated once; others, behind pseudo-terminals, are rebooted again and again, so
that at any moment some calibration is under way, being written, or just said.
"""

import os
import random
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Floats, Quality, Verdict
from estimator.client import Client
from estimator.database import inspect
from estimator.demo.subscribers import Watcher
from estimator.demo.ward import WARD, Ward
from estimator.service.store_reader import StoreReader
from estimator.tracking.bias_state import BiasKnobs
from tests.ward.parts import add_simulated, living, wait

_SPEED = 10.0
_RESTLESS_S = 1.5
#: a bias may move by so much of its standard deviation, and be known so many times worse than it was within so many seconds,
#: as a checkpoint is old where kills follow each other; and as much worse as it walks until a sample comes, rad/s per root second
SURE_SIGMAS, LESS_SURE, BACK_S = 3.0, 2.0, 60.0
WALK = BiasKnobs().warm_up_walk
#: who is back within so many seconds has missed nothing: a bridge keeps fifteen for who is away
KEPT_S = 10.0
#: until what had been said is heard
HEARD_S = 0.3


@dataclass(slots=True)
class Kill:
    """One kill. Seconds from the start of the next process to the first GOOD sample of one, and of every steady device.

    cpu_s: processor time of the next process until the first GOOD sample was heard; threads: once it serves.
    """

    first_s: float
    all_s: float
    cpu_s: float
    threads: int
    faults: list[str] = field(default_factory=list)
    moved: list[float] = field(default_factory=list)  # each steady device's bias, in standard deviations


class Holes:
    """Samples that are missing between those that came of each boot, but of who was away for longer than bridges keep."""

    def __init__(self) -> None:
        self._next: dict[tuple[str, int], int] = {}
        self._heard: dict[tuple[str, int], float] = {}
        self._missing: Counter[str] = Counter()
        self._told: Counter[str] = Counter()

    def take(self, batch: CorrectedBatch, at: float) -> None:
        boot = batch.device, batch.boot
        missing = batch.sequence - self._next.get(boot, batch.sequence)
        if missing > 0 and at - self._heard[boot] < KEPT_S:
            self._missing[batch.device] += missing
        self._next[boot], self._heard[boot] = batch.sequence + len(batch), at

    def new(self) -> list[str]:
        """Of which devices how many since this was asked last, in words: none is between two questions."""
        missing = self._missing.copy()
        new, self._told = missing - self._told, missing
        return [f"{name}: {count} samples never came" for name, count in new.items()]


class Ear(threading.Thread):
    """Hears corrected rates of the whole ward, each sample once: the latest GOOD batch of a device, and holes in its numbers."""

    def __init__(self, endpoint: str) -> None:
        super().__init__(daemon=True)
        self._client = Client((endpoint,), ward=WARD)
        self._corrected = self._client.corrected()
        self._over = threading.Event()
        self.good: dict[str, tuple[float, CorrectedBatch]] = {}
        self.first: dict[str, tuple[float, CorrectedBatch]] = {}
        self._lately: dict[str, deque[tuple[float, CorrectedBatch]]] = {}
        self.holes = Holes()
        self.start()

    def run(self) -> None:
        while not self._over.is_set():
            batch = self._corrected.receive(0.1)
            if batch is None:
                continue
            self.holes.take(batch, time.monotonic())
            if batch.quality is Quality.GOOD:
                heard = time.monotonic(), batch
                self.good[batch.device] = heard
                self.first.setdefault(batch.device, heard)
                lately = self._lately.setdefault(batch.device, deque())
                lately.append(heard)
                while lately[0][0] < heard[0] - BACK_S:
                    lately.popleft()

    def bias_std(self, device: str) -> Floats:
        """How surely its bias was known lately, when it was known worst, rad/s."""
        return np.asarray(np.max([batch.bias_std for _, batch in self._lately[device]], axis=0), np.float64)

    def close(self) -> None:
        self._over.set()
        self.join()
        self._client.close()


class Victim:
    """A ward with `steady` devices in the bridge and `restless` ones behind pseudo-terminals."""

    def __init__(self, ward: Ward, steady: list[str], restless: list[str]) -> None:
        self.ward, self.steady, self.restless = ward, steady, restless
        self.store = ward.folder / "truerate.sqlite3"
        self.ear, self.watcher = Ear(ward.endpoint), Watcher(ward.endpoint, WARD)
        self._bus = ZenohBus((ward.endpoint,))
        self._calibrations = self._bus.subscribe(keys.pattern(WARD, "calibration"))
        self.acknowledged: dict[str, str] = {}
        self._rebooted: dict[str, float] = {}

    def listen(self, until_s: float) -> None:
        """Until a moment: take note of what is acknowledged, and reboot restless devices that have been calibrated."""
        while time.monotonic() < until_s:
            for message in self._calibrations.drain(100, min(0.02, max(0.0, until_s - time.monotonic()))):
                found = codec.decode_calibration(message.key, message.payload)
                if found.verdict is Verdict.ACCEPTED:
                    self.acknowledged[found.id] = found.device
                    self._rebooted.setdefault(found.device, time.monotonic() + _RESTLESS_S)
            for name in self.restless:
                if self._rebooted.get(name, np.inf) < time.monotonic():
                    del self._rebooted[name]
                    self.ward.ports[name].device.reboot()
            self.watcher.poll()

    def kill(self, lasts_s: float, away_s: float) -> Kill:
        """Listen for so long, kill the estimator, start it again after some time, and hold what comes against what was."""
        self.listen(time.monotonic() + lasts_s)
        self.ward.stop("estimator", signal.SIGKILL)
        self.listen(time.monotonic() + away_s)
        before, known = dict(self.ear.good), {name: self.ear.bias_std(name) for name in self.steady}
        inspection = inspect(self.store)
        faults = [] if inspection.sound else [f"the store: {inspection}"]
        self.ear.first.clear()
        begun = time.monotonic()
        self.ward.start("estimator")
        deadline, cpu_s = begun + 90.0, np.inf
        while not self.ear.first.keys() >= set(self.steady) and time.monotonic() < deadline:
            self.listen(time.monotonic() + 0.01)
            if self.ear.first and not np.isfinite(cpu_s):
                cpu_s = self._cpu_s()
        first = {name: self.ear.first[name] for name in self.steady if name in self.ear.first}
        for name in self.steady:
            faults += (
                discontinued(name, before[name][1], known[name], first[name][1])
                if name in first
                else [f"{name}: nothing GOOD"]
            )
        moved = [_moved(before[name][1], batch) for name, (_, batch) in first.items()]
        moments = [moment - begun for moment, _ in first.values()] or [np.inf]
        faults += self.ear.holes.new()
        return Kill(min(moments), max(moments), cpu_s, self._threads(), faults, moved)

    def _cpu_s(self) -> float:
        """Processor time of the estimator so far, s."""
        fields = Path(f"/proc/{self.ward.pid('estimator')}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def _threads(self) -> int:
        return len(list(Path(f"/proc/{self.ward.pid('estimator')}/task").iterdir()))

    def lost(self) -> list[str]:
        """Calibrations that were acknowledged and are not in the store."""
        store = StoreReader.reading(self.store)
        kept = {name: {c.id for c in store.calibrations(name)} for name in {*self.acknowledged.values()}}
        store.close()
        return [name for name, device in self.acknowledged.items() if name not in kept[device]]

    def close(self) -> None:
        self.ear.close()
        self.watcher.close()
        self._bus.close()


def _moved(before: CorrectedBatch, after: CorrectedBatch) -> float:
    """How far the bias has gone meanwhile, in standard deviations of who is less sure: what a rest taught may be news to one."""
    std = np.maximum(before.bias_std, after.bias_std)
    return float(np.max(np.abs(after.bias - before.bias) / std))


def discontinued(name: str, before: CorrectedBatch, bias_std: Floats, after: CorrectedBatch) -> list[str]:
    """What is not as it was: the calibration, the bias, or how surely that was known, rad/s."""
    faults = []
    if after.calibration != before.calibration:
        faults.append(f"{name}: calibration {after.calibration} after {before.calibration}")
    if (moved := _moved(before, after)) > SURE_SIGMAS:
        faults.append(f"{name}: the bias moved by {moved:.2f} of its standard deviation")
    walked = WALK * np.sqrt(max(0.0, after.device_time[0] - before.device_time[-1]))
    if np.any(after.bias_std > LESS_SURE * bias_std + walked):
        known = " after ".join(f"{np.degrees(std)}" for std in (after.bias_std, bias_std))
        faults.append(f"{name}: its bias is known to {known} °/s, as if little had been kept")
    return faults


@contextmanager
def victim(folder: Path, steady: int, restless: int, speed: float = 1.0) -> Iterator[Victim]:
    """A ward whose devices are all calibrated."""
    names = [f"s{number:02d}" for number in range(steady)]
    others = tuple(f"r{number}" for number in range(restless))
    with Ward(folder, others) as ward:
        add_simulated(ward, names, speed)
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        made = Victim(ward, names, list(others))
        try:
            for seed, name in enumerate(others):
                ward.plug(name, living(name, seed=100 + seed), speed=_SPEED, lossless=True)
            wait(
                "calibrations", lambda: made.ear.good.keys() >= {*names}, made.watcher, ward, timeout_s=90 / speed + 30
            )
            yield made
        finally:
            made.close()


def killed(
    folder: Path, kills: int, steady: int, restless: int, seed: int, *, away_s: float = HEARD_S, speed: float = 1.0
) -> Iterator[Kill]:
    """So many kills, one after the other; the last is followed by a look for calibrations that were lost.

    away_s: how long the estimator is away each time, at least as long as it takes to hear all that it said.
    """
    chance = random.Random(seed)
    with victim(folder, steady, restless, speed) as made:
        for number in range(kills):
            kill = made.kill(chance.uniform(0.0, 3.0), away_s)
            if number == kills - 1:
                made.listen(time.monotonic() + 1.0)
                made.ward.stop("estimator", signal.SIGKILL)
                kill.faults += made.ear.holes.new()
                kill.faults += [f"calibration {name} was said and is lost" for name in made.lost()]
                if not made.acknowledged:
                    kill.faults.append("no calibration was said")
            yield kill
