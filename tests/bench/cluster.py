"""Three estimators share 300 devices: what a subscriber notices when one is killed, or hangs and wakes up. `make bench-cluster`.

Router, bridge and estimators are processes of their own. A gap is the longest time between two batches of a device that were
new to the subscriber, beside what it is for the devices of the others at the same moment: that is the machine's own part. What
came is looked through when all is over: the processors are the ward's.

`--kills`: nobody hangs.
"""

import argparse
import gc
import math
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bridge.bus.contract import Message
from bridge.bus.zenoh_bus import ZenohBus
from bridge.terminal.tables import Column, Columns
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Owned
from estimator.client.reorder_buffer import ReorderBuffer
from estimator.demo.ward import free_port
from estimator.kernels.compiled import ready
from estimator.service.membership import owner
from tests.bench.load import stream
from tests.bench.load.stream import WARD
from tests.bench.network.guarded import Heard
from tests.bench.network.judge import judged
from tests.bench.programs import CLI, line, program, ward_file

NAMES = ("estimator-1", "estimator-2", "estimator-3")
RATE_HZ, SAMPLES = 104.0, 5
GAP_S, STOPPED_S, STOP_S = 1.0, 3.0, 5.0
#: after each: a restarted estimator reads the past and takes its devices back, which costs all three some seconds here
SETTLED_S = 15.0
#: shares of so many devices or more may be so far from even (those of fewer are chance's); and a device of which nothing came of
#: the last seconds is silent
EVEN, MANY, SILENT_S = 0.2, 300, 2.0
#: how long a subscriber waits for a hole; and messages that wait for us
PATIENT_S, ROOM = 10.0, 1 << 18


class Trouble(NamedTuple):
    """Fault given to the estimator that owned these devices: its kind, its time, and the gap allowed."""

    what: str
    at: float
    theirs: set[str]
    goal_s: float


class Cluster:
    """The processes, and a subscriber that keeps when each batch came."""

    def __init__(self, folder: Path, stack: ExitStack, devices: int, seconds: float) -> None:
        self._folder, self._stack, self._devices = folder, stack, devices
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.processes: dict[str, subprocess.Popen[str]] = {}
        # The router of a ward does not wait for a viewer that is slow: on a busy machine that loss would be counted here.
        line(stack.enter_context(program("tests.bench.router", self.endpoint, pipe=True)))
        bus = stack.enter_context(ZenohBus([self.endpoint]))
        self._heard = bus.subscribe(keys.pattern(WARD, "owned"))
        self.owned: dict[str, Owned] = {}
        reader = stack.enter_context(ZenohBus([self.endpoint]))
        self.corrected = reader.subscribe(keys.pattern(WARD, "corrected"), history=True, capacity=ROOM)
        self.came: list[tuple[float, list[Message]]] = []
        for name in NAMES:
            self.start(name)
        self.until(lambda: len(self.owned) == len(NAMES), 60.0)
        words = [self.endpoint, str(devices), str(RATE_HZ), str(SAMPLES), "paced", str(seconds), "0"]
        stack.enter_context(program("tests.bench.load.sender", *words))

    def start(self, name: str) -> None:
        (place := self._folder / name).mkdir(exist_ok=True)
        file = ward_file(place, WARD, self.endpoint, stream.listed(self._devices))
        file.write_text(file.read_text().replace('id = "e"', f'id = "{name}"'))
        self.processes[name] = self._stack.enter_context(program(CLI, "estimator", "serve", str(file)))

    def poll(self, wait_s: float = 0.01) -> None:
        if messages := self.corrected.drain(ROOM, wait_s):
            self.came.append((time.monotonic(), messages))
        for message in self._heard.drain(4096, 0.0):
            owned = codec.decode_owned(message.key, message.payload)
            self.owned[owned.estimator] = owned

    def until(self, true: Callable[[], bool], timeout_s: float) -> None:
        began = time.monotonic()
        while not true():
            if time.monotonic() - began > timeout_s:
                raise RuntimeError(f"it did not come: {self.shares()}")
            self.poll()

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end, seconds + 60.0)

    def has(self, name: str) -> set[str]:
        return {h.device for h in self.owned[name].holdings} if name in self.owned else set()

    def left(self, victim: str, devices: set[str]) -> bool:
        """True if another estimator than the victim owns each of these devices, under a higher epoch."""
        epochs = {name: {h.device: h.epoch for h in owned.holdings} for name, owned in self.owned.items()}
        old = epochs.pop(victim, {})
        return all(any(of.get(d, -1) > old.get(d, 0) for of in epochs.values()) for d in devices)

    def home(self) -> bool:
        """True if each device belongs to the estimator that its hash names while all three live."""
        devices = set().union(*map(self.has, NAMES))
        return len(devices) == self._devices and all(
            self.has(name) == {d for d in devices if owner(d, NAMES) == name} for name in NAMES
        )

    def shares(self) -> dict[str, int]:
        return {name: len(self.has(name)) for name in NAMES}


class Given(Heard):
    """Batches that a subscriber with this wait delivers, of all that arrived, and their times."""

    def __init__(self, came: list[tuple[float, list[Message]]]) -> None:
        super().__init__()
        self.buffer = ReorderBuffer(PATIENT_S)
        for at, messages in came:
            for message in messages:
                self.buffer.feed(codec.decode_corrected(message.key, message.payload), at)
            self.buffer.overdue(at)
            self._take(at)
        self.buffer.overdue(math.inf)
        self._take(came[-1][0])

    def _take(self, at: float) -> None:
        for event in self.buffer.ready:
            if isinstance(event, CorrectedBatch):
                said = {"device": event.device, "boot": event.boot, "first": event.sequence, "n": len(event)}
                self.batches.append({"at": at, "epoch": event.epoch, "good": False, "old": 0, **said})
        self.buffer.ready.clear()

    def gaps(self, devices: set[str], since: float, for_s: float) -> NDArray[np.float64]:
        """(devices,) the longest silence of each in so long, or that begins in it and ends within a second more."""
        begin, end = since - 1.0, since + for_s + 1.0  # what has not come since or by then is a gap, too
        moments = {device: [begin] for device in sorted(devices)}
        for batch in self.batches:
            if batch["device"] in devices and begin <= batch["at"] <= end:
                moments[batch["device"]].append(batch["at"])
        found = []
        for of in moments.values():
            at = np.array([*of, end])
            during = (at[1:] >= since) & (at[:-1] <= since + for_s)
            found.append(np.diff(at)[during].max(initial=0.0))
        return np.array(found)

    def moves(self, since: float) -> int:
        """How often a device went to another estimator, as its corrected samples came."""
        return sum(
            before["epoch"] != after["epoch"]
            for batches in self.by_boot(since).values()
            for before, after in pairwise(batches)
        )

    def silent(self, devices: int) -> int:
        """Devices that end before the others, which are all sent alike."""
        ends: dict[str, int] = {batch["device"]: batch["first"] + batch["n"] for batch in self.batches}
        least = max(ends.values(), default=0) - SILENT_S * RATE_HZ
        return devices - sum(end >= least for end in ends.values())


def _ms(seconds: float | np.floating[Any]) -> str:
    return f"{1e3 * seconds:.0f} ms"


def _disturb(cluster: Cluster, rounds: int, *, kills: bool) -> list[Trouble]:
    """Kill and stop estimators in turn; each time all devices are at home again in the end."""
    done = [Trouble("nothing", time.monotonic(), set(), 0.0)]
    cluster.listen(STOP_S)
    for number in range(rounds):
        victim = NAMES[number % len(NAMES)]
        for what, goal_s in (("SIGKILL", GAP_S), ("SIGSTOP", STOPPED_S))[: 1 if kills else 2]:
            theirs, process = cluster.has(victim), cluster.processes[victim]
            done.append(Trouble(what, time.monotonic(), theirs, goal_s))
            process.send_signal(getattr(signal, what))
            cluster.until(lambda: cluster.left(victim, theirs), 30.0)  # noqa: B023 - done at once
            cluster.owned.pop(victim)
            cluster.listen(STOP_S)
            if what == "SIGSTOP":
                process.send_signal(signal.SIGCONT)
            else:
                process.wait()
                cluster.start(victim)
            cluster.until(cluster.home, 60.0)
            cluster.listen(SETTLED_S)
    return done


def main() -> int:
    """Print what was found; 1 when a sample was lost, given twice, or taken from who had lost its device, or a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--kills", action="store_true")
    args = parser.parse_args()
    console = Console(width=140)
    ready()  # a first compilation takes longer than an estimator may need to start
    gc.disable()  # it keeps all that comes: to look through that would hold up everything, and be taken for the ward's
    headings = ("devices", "gap p50", "worst", "others' p50", "worst", "goal")
    table = Columns([Column("what"), *(Column(words, number=True) for words in headings)])
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        cluster = Cluster(Path(folder), stack, args.devices, 90.0 * args.rounds + 60.0)
        cluster.until(cluster.home, 60.0)
        cluster.listen(3.0)
        even = args.devices / len(NAMES)
        worst = max(abs(n - even) / even for n in cluster.shares().values())
        console.print(f"shares: {cluster.shares()}, {worst:.0%} from even at most (goal {EVEN:.0%})")
        missed = [f"shares {worst:.0%} from even"] if worst > EVEN and args.devices >= MANY else []
        console.print(f"processor time: { {name: f'{owned.load:.0%}' for name, owned in cluster.owned.items()} }")
        every = set().union(*map(cluster.has, NAMES))
        done = _disturb(cluster, args.rounds, kills=args.kills)
    given = Given(cluster.came)
    for trouble in done:
        words = [""] * 3
        if trouble.theirs:
            gaps = given.gaps(trouble.theirs, trouble.at, 3.0)
            words = [str(len(trouble.theirs)), _ms(np.median(gaps)), _ms(gaps.max())]
            if gaps.max() > trouble.goal_s:
                missed.append(f"a gap of {_ms(gaps.max())} after {trouble.what} (goal {_ms(trouble.goal_s)})")
        usual = given.gaps(every - trouble.theirs, trouble.at, 3.0)
        table.add(trouble.what, *words, _ms(np.median(usual)), _ms(usual.max()), _ms(trouble.goal_s))
    console.print(table)
    had_to = 2 * sum(len(trouble.theirs) for trouble in done)
    console.print(f"devices went to another estimator {given.moves(done[0].at)} times; had to {had_to} times")
    verdict, silent = judged(given, 0.0), given.silent(args.devices)
    console.print(
        f"{verdict.samples:,} samples given: {verdict.broken or 'each once'}; {silent} devices silent to the end;"
        f" missing {sum(given.buffer.missing.values())}, missed {cluster.corrected.missed}"
    )
    if missed:
        console.print(f"not reached: {'; '.join(missed)}")
    return int(bool(missed or verdict.broken or silent))


if __name__ == "__main__":
    sys.exit(main())
