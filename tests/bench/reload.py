"""Devices added, renamed and removed in a running ward: what the others notice of it. `make bench-bridge`.

Real processes: router, bridge with simulated devices, estimator. The ward file is changed three times while all are tracked.
The simulated devices get a new boot whenever they are opened, so a device that was touched shows it.
"""

import argparse
import contextlib
import io
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from rich.console import Console

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys
from bridge.wire.messages import Quality
from estimator.cli.main import main as truerate
from estimator.demo.subscribers import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward
from tests.ward.parts import add_simulated, wait

ADDED, RENAMED = "added", "renamed"
#: part of the devices to be calibrated before the changes: now and then a simulated turn is refused
_ENOUGH = 0.9


@dataclass
class Outcome:
    """What each reload said; and of the devices that stayed: boots, missing samples, calibrations, dead tokens."""

    said: list[tuple[int, str]] = field(default_factory=list)
    boots: dict[str, int] = field(default_factory=dict)
    missing: dict[str, int] = field(default_factory=dict)
    calibrations: dict[str, int] = field(default_factory=dict)
    tokens_died: int = 0
    samples: int = 0
    troubles: str = ""

    @property
    def undisturbed(self) -> bool:
        """One boot, at most one calibration and no missing sample for each device that stayed."""
        once = all(n == 1 for n in self.boots.values()) and all(n < 2 for n in self.calibrations.values())
        return once and not any(self.missing.values()) and not self.tokens_died and not self.troubles


def measure(folder: Path, devices: int, speed: float) -> Outcome:
    """Add, rename and remove one device beside so many others, and look at the others."""
    stay, going = [f"d{number}" for number in range(devices)], "going"
    with Ward(folder, ()) as ward:
        add_simulated(ward, [*stay, going], speed)
        whole = ward.config.read_text("utf-8")
        ward.start("router", "estimator")
        ward.wait_for_router()
        watcher, died = Watcher(ward.endpoint, WARD), list[str]()
        with contextlib.closing(watcher), ZenohBus((ward.endpoint,)) as bus:
            bus.watch_alive(keys.pattern(WARD, "alive/device"), lambda key, alive: None if alive else died.append(key))
            wait("the estimator", lambda: "serves ward" in ward.log("estimator"), watcher, ward)
            ward.start("bridge")  # the devices turn when it begins
            wait("calibrations", lambda: _calibrated(watcher) >= _ENOUGH * (devices + 1), watcher, ward)
            subscriber = Subscriber(ward.endpoint, WARD, keep=True)
            outcome = Outcome()
            deadline = time.monotonic() + 90.0
            for text, until in _changes(whole, going, ward, watcher):
                ward.config.write_text(text, "utf-8")
                code, said = _reloaded(ward.config)
                # On a busy machine a program may take longer than the command waits for it.
                while (code or not ("bridge-1:" in said and "estimator-1:" in said)) and time.monotonic() < deadline:
                    code, said = _reloaded(ward.config)
                outcome.said.append((code, said))
                wait("the change", until, watcher, ward)
            subscriber.close()
    for name in stay:
        batches = [batch for (device, _), found in subscriber.batches.items() if device == name for batch in found]
        outcome.boots[name] = len({batch.boot for batch in batches})
        outcome.missing[name] = sum(b.sequence - a.sequence - len(a) for a, b in pairwise(batches))
        outcome.calibrations[name] = len({batch.calibration for batch in batches if batch.quality is Quality.GOOD})
        outcome.samples += sum(map(len, batches))
    outcome.tokens_died = sum(keys.parse(key).device in stay for key in died)
    outcome.troubles = subscriber.troubles
    return outcome


def _calibrated(watcher: Watcher) -> int:
    return sum(bool(status.calibration) for status in watcher.statuses.values())


def _changes(whole: str, going: str, ward: Ward, watcher: Watcher) -> Iterator[tuple[str, Callable[[], bool]]]:
    """Contents of the ward file, each with what shows that it is in force."""
    more = whole.replace("[estimator]", _device(ADDED) + "[estimator]")
    yield more, lambda: ADDED in watcher.statuses
    renamed = more.replace(f'"{going}"', f'"{RENAMED}"')
    yield renamed, lambda: RENAMED in watcher.statuses
    yield renamed.replace(_device(ADDED), ""), lambda: f"-{ADDED}" in ward.log("bridge")


def _device(name: str) -> str:
    return f'[[bridge.devices]]\nid = "{name}"\ndriver = "simulated"\nseed = 99\n\n'


def _reloaded(config: Path) -> tuple[int, str]:
    """Exit code and output of `truerate reload`."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        code = truerate(["reload", "--config", str(config)])
    return code, out.getvalue()


def main(words: list[str]) -> int:
    """Print what came out; 1 if a device that stayed was disturbed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=50)
    parser.add_argument("--speed", type=float, default=1.0, help="times real time")
    given = parser.parse_args(words)
    console = Console()
    with tempfile.TemporaryDirectory() as folder:
        found = measure(Path(folder), given.devices, given.speed)
    for code, said in found.said:
        console.print(f"exit code {code}: {said.strip()}", highlight=False)
    console.print(
        f"{given.devices} devices that stayed: {found.samples} samples, {sum(found.missing.values())} missing (goal 0);"
        f" {sum(n - 1 for n in found.boots.values())} new boots (goal 0);"
        f" {sum(max(0, n - 1) for n in found.calibrations.values())} new calibrations (goal 0);"
        f" {found.tokens_died} tokens died (goal 0); {found.troubles or 'no trouble at the subscriber'}"
    )
    return 0 if found.undisturbed else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
