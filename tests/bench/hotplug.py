"""Unplugged and plugged in again, a thousand times: how soon it is back, and what is left behind. `make bench-bridge`.

One device on a pseudo-terminal is pulled again and again while a second one beside it is read; then many that are not there
at all are waited for.
"""

import logging
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from bridge.config.schema import Bridge, Device
from bridge.drivers.byte_stream import StreamOptions
from bridge.ingest.pump import Pump
from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import demo_device
from bridge.wire import codec, keys
from bridge.wire.messages import SampleBatch
from tests.memory_bus import MemoryBroker, MemoryBus

PULLED, BESIDE = "pulled", "beside"
_GOAL_S, _GOAL_PERCENT = 0.25, 1.0
_PATIENCE_S = 60.0


@dataclass
class Outcome:
    """Seconds from each return of the port to the first sample of it on the bus; what was open before and after."""

    back_s: list[float] = field(default_factory=list)
    files: tuple[int, int] = (0, 0)
    threads: tuple[int, int] = (0, 0)
    beside: list[SampleBatch] = field(default_factory=list)

    @property
    def beside_unbroken(self) -> bool:
        """No sample of the other device is missing, and none came twice."""
        ends = [batch.sequence + len(batch) for batch in self.beside]
        return all(batch.sequence == end for batch, end in zip(self.beside[1:], ends, strict=False))


class Ears:
    """Hears the bus; `there` says whether the pulled device's token is."""

    def __init__(self, broker: MemoryBroker) -> None:
        self.there = False
        self.heard = 0
        self.beside: list[SampleBatch] = []
        self._bus = MemoryBus(broker)
        self._bus.watch_alive(keys.ROOT + f"/w/alive/device/{PULLED}/*", self._alive)
        self._raw = self._bus.subscribe(keys.pattern("w", "raw"), history=True)

    def until(self, condition: Callable[[], bool]) -> None:
        """Listen until then."""
        end = time.monotonic() + _PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError("it did not come to pass")
            for message in self._raw.drain(1000, 0.01):
                batch = codec.decode_samples(*message)
                if batch.device == BESIDE:
                    self.beside.append(batch)
                else:
                    self.heard += 1

    def close(self) -> None:
        self._bus.close()

    def _alive(self, _: str, there: bool) -> None:
        self.there = there


def pull(folder: Path, times: int) -> Outcome:
    """Pull one device so often."""
    outcome, broker = Outcome(), MemoryBroker()
    ears = Ears(broker)
    with (
        PtyPort(demo_device(PULLED, 1), folder / PULLED) as port,
        PtyPort(demo_device(BESIDE, 2), folder / BESIDE, lossless=True) as two,
    ):
        devices = tuple(
            Device(name, "native", StreamOptions(port=str(p.link))) for name, p in ((PULLED, port), (BESIDE, two))
        )
        with MemoryBus(broker) as bus, Pump("w", Bridge(id="b1", batch_ms=20, devices=devices), bus):
            ears.until(lambda: bool(ears.there and ears.heard and ears.beside))
            files, threads = _open_files(), threading.active_count()
            for _ in range(times):
                port.unplug()
                ears.until(lambda: not ears.there)
                before = ears.heard
                port.plug()
                plugged_s = time.monotonic()
                ears.until(lambda before=before: ears.heard > before)  # type: ignore[misc]
                outcome.back_s.append(time.monotonic() - plugged_s)
                ears.until(lambda: ears.there)
            outcome.files, outcome.threads = (files, _open_files()), (threads, threading.active_count())
    outcome.beside = ears.beside
    ears.close()
    return outcome


def waiting_percent(folder: Path, devices: int, seconds: float) -> float:
    """CPU time, in percent of a core, of a bridge whose devices are all missing."""
    missing = tuple(Device(f"d{i}", "native", StreamOptions(port=str(folder / f"gone-{i}"))) for i in range(devices))
    with MemoryBus(MemoryBroker()) as bus, Pump("w", Bridge(id="b1", batch_ms=1000, devices=missing), bus):
        time.sleep(1.0)
        spent, begun = time.process_time(), time.monotonic()
        time.sleep(seconds)
        return 100 * (time.process_time() - spent) / (time.monotonic() - begun)


def _open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def main(times: int = 1000) -> None:
    """Print what came out."""
    console = Console()
    logging.disable()  # each pull is a warning
    with tempfile.TemporaryDirectory() as folder:
        outcome = pull(Path(folder), times)
        back = sorted(outcome.back_s)
        console.print(f"{len(back)} of {times} recoveries; goal {_GOAL_S * 1e3:.0f} ms each")
        console.print(
            f"back after {statistics.median(back) * 1e3:.0f} ms (median), "
            f"{back[int(0.99 * len(back))] * 1e3:.0f} ms (99 of 100), {back[-1] * 1e3:.0f} ms (worst)"
        )
        console.print(
            f"open files {outcome.files[0]} → {outcome.files[1]}, threads {outcome.threads[0]} → {outcome.threads[1]}"
        )
        console.print(f"the device beside it: {'unbroken' if outcome.beside_unbroken else 'DISTURBED'}")
        percent = waiting_percent(Path(folder), 20, 20.0)
        console.print(f"waiting for 20 devices that are missing: {percent:.2f} % of a core (goal {_GOAL_PERCENT:g} %)")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
