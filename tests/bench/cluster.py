"""Three estimators share 300 devices: what a subscriber notices when one is killed, or hangs and wakes up. `make bench-cluster`.

Router, bridge and estimators are processes of their own. A gap is the longest time between two batches of a device that were
new to the subscriber, beside what it is for the devices of the others at the same moment: that is the machine's own part. So is
how long the system needs to end a killed process: its connections live until then, and nobody knows. What came is looked through
when all is over: the processors are the ward's.

`--kills`: nobody hangs.

`--beside N`: so many other programs take a processor each, if they get it: a ward whose machine has too much to do.
"""

import argparse
import gc
import itertools
import math
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bridge.bus.contract import Message
from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.terminal.tables import Column, Columns
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Owned
from estimator.client.reorder_buffer import ReorderBuffer
from estimator.demo.ward import free_port, listens
from estimator.service.membership import owner
from tests.bench.load import stream
from tests.bench.load.stream import WARD

NAMES = ("estimator-1", "estimator-2", "estimator-3")
RATE_HZ, SAMPLES = 104.0, 5
GAP_S, STOPPED_S, STOP_S = 1.0, 3.0, 5.0
#: shares of so many devices or more may be so far from even (those of fewer are chance's); and a device of which nothing came of
#: the last seconds is silent
EVEN, MANY, SILENT_S = 0.2, 300, 2.0
#: how long a subscriber waits for a hole; and messages that wait for us
PATIENT_S, ROOM = 10.0, 1 << 18
_CONFIG = """ward = "{ward}"
[bus]
connect = ["{endpoint}"]
[estimator]
id = "{name}"
store = "{folder}/{name}.sqlite3"
"""


class Trouble(NamedTuple):
    """What was done to whoever had these devices, and when; the gap it may cause, and how long until the process had ended."""

    what: str
    at: float
    theirs: set[str]
    goal_s: float
    ended_s: float


class Cluster:
    """The processes, and a subscriber that keeps when each batch came.

    load: what the sender is told, after devices, rate and samples; core: the processor that estimators are held to.
    """

    def __init__(
        self,
        folder: Path,
        stack: ExitStack,
        devices: int,
        load: tuple[str, str],
    ) -> None:
        self.folder, self._stack, self._devices = folder, stack, devices
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        # The router of a ward does not wait for a viewer that is slow: on a busy machine that loss would be counted here.
        stack.enter_context(_process("tests.bench.cluster", "router", self.endpoint))
        if not listens(self.endpoint, 20.0):
            raise RuntimeError("the router does not listen")
        bus = stack.enter_context(ZenohBus([self.endpoint]))
        self._heard = bus.subscribe(keys.pattern(WARD, "owned"))
        self.owned: dict[str, Owned] = {}
        reader = stack.enter_context(ZenohBus([self.endpoint]))
        self._corrected = reader.subscribe(keys.pattern(WARD, "corrected"), history=True, capacity=ROOM)
        self.came: list[tuple[float, list[Message]]] = []
        for name in NAMES:
            self.start(name)
        self.until(lambda: len(self.owned) == len(NAMES), 60.0)
        arguments = [self.endpoint, str(devices), str(RATE_HZ), str(SAMPLES), *load, "0"]
        self.sender = stack.enter_context(_process("tests.bench.load.sender", *arguments, pipe=True))

    def start(self, name: str) -> None:
        config = self.folder / f"{name}.toml"
        config.write_text(
            _CONFIG.format(ward=WARD, endpoint=self.endpoint, name=name, folder=self.folder)
            + stream.listed(self._devices),
            encoding="utf-8",
        )
        process = self._stack.enter_context(_process("estimator.cli.main", "estimator", "serve", str(config)))
        self.processes[name] = process

    def poll(self, wait_s: float = 0.01) -> None:
        if messages := self._corrected.drain(ROOM, wait_s):
            self.came.append((time.monotonic(), messages))
        for message in self._heard.drain(4096, 0.0):
            owned = codec.decode_owned(message.key, message.payload)
            self.owned[owned.estimator] = owned

    def until(self, true: Callable[[], bool], timeout_s: float) -> float:
        began = time.monotonic()
        while not true():
            if time.monotonic() - began > timeout_s:
                raise RuntimeError(f"it did not come: {self.shares()}")
            self.poll()
        return time.monotonic() - began

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end, seconds + 60.0)

    def has(self, name: str) -> set[str]:
        return {h.device for h in self.owned[name].holdings} if name in self.owned else set()

    def left(self, victim: str, devices: set[str]) -> bool:
        """Whether each of these is another's than the victim's, whose last words may still be under way."""
        epochs = {
            name: {h.device: h.epoch for h in owned.holdings} for name, owned in self.owned.items() if name != victim
        }
        old = {h.device: h.epoch for h in self.owned[victim].holdings} if victim in self.owned else {}
        return all(any(of.get(d, -1) > old.get(d, 0) for of in epochs.values()) for d in devices)

    def home(self) -> bool:
        """Whether each device is where it is to be, with all of them alive."""
        devices = {h.device for owned in self.owned.values() for h in owned.holdings}
        return all(self.has(name) == {d for d in devices if owner(d, NAMES) == name} for name in NAMES)

    def shares(self) -> dict[str, int]:
        return {name: len(self.has(name)) for name in NAMES if name in self.owned}

    @property
    def missed(self) -> int:
        """Messages that the bus lost, or that found no room."""
        return self._corrected.missed


class Given:
    """What a subscriber that waits for so long is given of what came, and when."""

    def __init__(self, came: list[tuple[float, list[Message]]]) -> None:
        self.buffer = ReorderBuffer(PATIENT_S)
        self.batches: dict[str, list[tuple[float, CorrectedBatch]]] = {}
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
                self.batches.setdefault(event.device, []).append((at, event))
        self.buffer.ready.clear()

    @property
    def samples(self) -> int:
        return sum(len(batch) for batches in self.batches.values() for _, batch in batches)

    def gaps(self, devices: set[str], since: float, for_s: float) -> NDArray[np.float64]:
        """(devices,) the longest silence of each in so long, or that begins in it and ends within a second more."""
        found = []
        for device in sorted(devices):
            came = (at for at, _ in self.batches.get(device, ()))
            begin, end = since - 1.0, since + for_s + 1.0  # what has not come since or by then is a gap, too
            moments = np.array([begin, *(at for at in came if begin <= at <= end), end])
            during = (moments[1:] >= since) & (moments[:-1] <= since + for_s)
            found.append(np.diff(moments)[during].max(initial=0.0))
        return np.array(found)

    def moves(self, since: float) -> int:
        """How often a device went to another estimator, as its corrected samples came."""
        return sum(
            before.epoch != after.epoch
            for batches in self.batches.values()
            for (_, before), (at, after) in itertools.pairwise(batches)
            if at >= since
        )

    def faults(self, devices: Iterable[str]) -> dict[str, int]:
        """Samples that are not there, that are there twice, batches of an older epoch after a newer one, and devices at the end.

        All devices are sent alike: one that is behind the others in the end is silent.
        """
        lost = twice = older = silent = 0
        ends = {device: batches[-1][1].sequence + len(batches[-1][1]) for device, batches in self.batches.items()}
        least = max(ends.values(), default=0) - SILENT_S * RATE_HZ
        for device in devices:
            silent += ends.get(device, -math.inf) < least
            batches = self.batches.get(device, [])
            for (_, before), (_, after) in itertools.pairwise(batches):
                step = after.sequence - before.sequence - len(before)
                lost, twice = lost + max(0, step), twice + max(0, -step)
                older += after.epoch < before.epoch
        return {"lost": lost, "given twice": twice, "of an older epoch": older, "silent to the end": silent}


@contextmanager
def _process(module: str, *arguments: str, pipe: bool = False) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE if pipe else subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()


def _unreached(console: Console, missed: list[str]) -> bool:
    """Say which goals were missed, if any was."""
    if missed:
        console.print(f"not reached: {'; '.join(missed)}")
    return bool(missed)


def _ended(pid: int) -> float:
    """When a killed process of ours had, monotonic s; it is still to be waited for."""
    process = os.pidfd_open(pid)
    select.select([process], [], [])
    os.close(process)
    return time.monotonic()


def _ms(seconds: float | np.floating[Any]) -> str:
    return "" if math.isnan(seconds) else f"{1e3 * seconds:.0f} ms"


def main() -> int:
    """Print what was found; 1 when a sample was lost, given twice, or taken from who had lost its device, or a goal is missed."""
    if sys.argv[1:2] == ["router"]:
        with Router([sys.argv[2]]):
            threading.Event().wait()
    while sys.argv[1:2] == ["busy"]:
        pass
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--beside", type=int, default=0, metavar="N", help="programs that take a processor each")
    parser.add_argument("--kills", action="store_true")
    args = parser.parse_args()
    console = Console(width=140)
    gc.disable()  # it keeps all that comes: to look through that would hold up everything, and be taken for the ward's
    table = Columns(
        [
            Column("what"),
            *(
                Column(words, number=True)
                for words in ("devices", "gap p50", "worst", "others' p50", "worst", "ended after", "goal")
            ),
        ]
    )
    # Who waits for a process listens to nothing meanwhile.
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack, ThreadPoolExecutor(1) as waiter:
        cluster = Cluster(Path(folder), stack, args.devices, ("paced", str(55.0 * args.rounds + 60.0)))
        cluster.until(lambda: sum(cluster.shares().values()) == args.devices and cluster.home(), 60.0)
        for _ in range(args.beside):
            stack.enter_context(_process("tests.bench.cluster", "busy"))
        cluster.listen(3.0)
        even = args.devices / len(NAMES)
        worst = max(abs(n - even) / even for n in cluster.shares().values())
        console.print(f"shares: {cluster.shares()}, {worst:.0%} from even at most (goal {EVEN:.0%})")
        missed = [f"shares {worst:.0%} from even"] if worst > EVEN and args.devices >= MANY else []
        loads = {name: f"{owned.load:.0%}" for name, owned in cluster.owned.items()}
        console.print(f"processor time: {loads}")
        began = time.monotonic()
        every = {h.device for owned in cluster.owned.values() for h in owned.holdings}
        done = [Trouble("nothing", began, set(), 0.0, math.nan)]
        cluster.listen(STOP_S)
        for number in range(args.rounds):
            victim = NAMES[number % len(NAMES)]
            for what, goal_s in (("SIGKILL", GAP_S), ("SIGSTOP", STOPPED_S))[: 1 if args.kills else 2]:
                theirs = cluster.has(victim)
                process, at = cluster.processes[victim], time.monotonic()
                process.send_signal(getattr(signal, what))
                ended = waiter.submit(_ended, process.pid) if what == "SIGKILL" else None
                cluster.until(lambda: cluster.left(victim, theirs), 30.0)  # noqa: B023 - done at once
                cluster.owned.pop(victim)
                cluster.listen(STOP_S)
                done.append(Trouble(what, at, theirs, goal_s, math.nan if ended is None else ended.result() - at))
                if what == "SIGSTOP":
                    process.send_signal(signal.SIGCONT)
                else:
                    process.wait()
                    cluster.start(victim)
                cluster.until(cluster.home, 60.0)
        overrun = cluster.missed  # of what comes from now on nothing is taken
        given = Given(cluster.came)
        for trouble in done:
            words = [""] * 3
            if trouble.theirs:
                gaps = given.gaps(trouble.theirs, trouble.at, 3.0)
                words = [str(len(trouble.theirs)), _ms(np.median(gaps)), _ms(gaps.max())]
                if gaps.max() > trouble.goal_s:
                    missed.append(f"a gap of {_ms(gaps.max())} after {trouble.what} (goal {_ms(trouble.goal_s)})")
            usual = given.gaps(every - trouble.theirs, trouble.at, 3.0)
            words += [_ms(seconds) for seconds in (np.median(usual), usual.max(), trouble.ended_s)]
            table.add(trouble.what, *words, _ms(trouble.goal_s) if trouble.goal_s else "")
        console.print(table)
        had_to = 2 * sum(len(trouble.theirs) for trouble in done)
        console.print(f"devices went to another estimator {given.moves(began)} times; had to {had_to} times")
        faults = given.faults(map(stream.name, range(args.devices)))
        console.print(
            f"{given.samples:,} samples given; {faults}; repeated {given.buffer.repeated:,}; "
            f"missing {sum(given.buffer.missing.values())}, missed {overrun}"
        )
        return int(_unreached(console, missed) or any(faults.values()))


if __name__ == "__main__":
    sys.exit(main())
