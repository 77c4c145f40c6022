"""How long a ward takes to recover: seconds from the repair to the next GOOD corrected sample. `make bench`.

Real processes, a real router and a pseudo-terminal; medians over a few rounds. A device lives ten times as fast as life, so
that it is calibrated soon; processes and timeouts live in real time.
"""

import contextlib
import signal
import statistics
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bridge.wire.messages import Quality, State
from estimator.demo.audience import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward
from tests.ward.parts import living, wait

NAME, SPEED, GOAL_S = "wrist", 10.0, 5.0


class Bench:
    """One ward with one calibrated device."""

    def __init__(self, ward: Ward) -> None:
        self.ward = ward
        self.watcher, self.subscriber = Watcher(ward.endpoint, WARD), Subscriber(ward.endpoint, WARD, keep=True)
        ward.plug(NAME, living(NAME, seed=3), speed=SPEED)
        wait("a calibration", lambda: self.watcher.all_tracking(1), self.watcher, ward)

    def good(self) -> int:
        """GOOD samples so far."""
        return sum(len(b) for batches in self.subscriber.batches.values() for b in batches if b.quality is Quality.GOOD)

    def until_good(self) -> float:
        """Seconds to the next GOOD sample."""
        before = self.good()
        return wait("a good sample", lambda: self.good() > before, self.watcher, self.ward)

    def replug(self) -> float:
        """Pull the cable, wait for the loss, plug it in again."""
        port = self.ward.ports[NAME]
        port.unplug()
        wait("the loss", lambda: self.watcher.statuses[NAME].state is State.LOST, self.watcher, self.ward)
        port.plug()
        return self.until_good()

    def restart(self, part: str) -> float:
        """Kill a process, wait until nothing comes, start it again."""
        self.ward.stop(part, signal.SIGKILL)
        with contextlib.suppress(AssertionError):
            wait("silence", lambda: False, self.watcher, self.ward, timeout_s=0.5)
        self.ward.start(part)
        return self.until_good()

    def close(self) -> None:
        self.subscriber.close()
        self.watcher.close()


@contextlib.contextmanager
def running() -> Iterator[Bench]:
    with tempfile.TemporaryDirectory() as folder, Ward(Path(folder), (NAME,)) as ward:
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        bench = Bench(ward)
        try:
            yield bench
        finally:
            bench.close()


def main(rounds: int = 5) -> None:
    """Print a table."""
    console = Console()
    seconds: dict[str, list[float]] = {}
    with running() as bench:
        for number in range(rounds):
            console.print(f"round {number + 1} of {rounds}", style="dim")
            seconds.setdefault("device replugged", []).append(bench.replug())
            for part in ("bridge", "estimator", "router"):
                seconds.setdefault(f"{part} killed and restarted", []).append(bench.restart(part))
    table = Table(title=f"Seconds from the repair to the next GOOD sample (goal {GOAL_S:g})")
    for heading in ("", "median", "worst"):
        table.add_column(heading, justify="right" if heading else "left")
    for what, values in seconds.items():
        table.add_row(what, f"{statistics.median(values):.2f}", f"{max(values):.2f}")
    console.print(table)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
