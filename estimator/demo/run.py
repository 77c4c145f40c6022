"""Command `truerate demo`: six devices boot, are turned, calibrated and tracked; one reboots; the results are judged."""

import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

from bridge.sim.virtual_device import DeviceSpec, VirtualDevice, demo_device
from bridge.terminal.tables import Column, Columns
from estimator.demo import figure
from estimator.demo.judge import Judgement, in_words, judge
from estimator.demo.subscribers import Boot, Subscriber, Watcher
from estimator.demo.ward import WARD, Ward
from estimator.geometry.gyro_model import AXES
from estimator.terminal.ward_table import LiveTable, table

NAMES = ("ankle-left", "ankle-right", "back", "chest", "wrist-left", "wrist-right")
REBOOTED = "chest"
STAGGER_S, REBOOT_S, END_S, LATEST_S = 0.4, 32.0, 66.0, 80.0
SUBSCRIBERS = 3


def run(console: Console, picture: Path, seed: int) -> bool:
    """Run the demonstration, print its results and save its figure; returns True if every check passed.

    picture: file of the figure. seed: seed of the simulated devices.
    """
    # A signal must end the started processes too.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda got, _: sys.exit(128 + got))
    folder = Path(tempfile.mkdtemp(prefix="truerate-demo-"))
    console.print(
        f"Starting router, bridge, estimator and dashboard as processes; their logs are in {folder}", soft_wrap=True
    )
    # A device waits for the bridge, so that its first sample counts too.
    devices = {name: demo_device(name, seed + n, spec=DeviceSpec(wait_for_host=True)) for n, name in enumerate(NAMES)}
    with Ward(folder, NAMES) as ward:
        ward.start("router", "estimator", "bridge", "dashboard")
        console.print(f"The ward in a browser: http://{ward.page}", soft_wrap=True)
        ward.wait_for_router()
        subscribers = [Subscriber(ward.endpoint, WARD, keep=number == 0) for number in range(SUBSCRIBERS)]
        watcher = Watcher(ward.endpoint, WARD)
        try:
            _live(console, ward, devices, watcher)
            for device in devices.values():
                device.power_off()
            time.sleep(1.0)
            watcher.poll()
        except BaseException:
            ward.close()  # processes first, whatever the reason
            for subscriber in subscribers:
                subscriber.close(0.0)
            console.print(f"Interrupted; the logs are in {folder}", soft_wrap=True)
            raise
        for subscriber in subscribers:
            subscriber.close()
        watcher.close()
        console.print(table(watcher.statuses, "The ward at the end"))
        console.print()
    right = _summary(console, devices, watcher, subscribers, picture)
    if right:
        shutil.rmtree(folder)
    return right


def _live(console: Console, ward: Ward, devices: dict[str, VirtualDevice], watcher: Watcher) -> None:
    begin = time.monotonic()
    waiting, rebooted, told = list(NAMES), False, False
    with LiveTable(console) as screen:
        while (elapsed := time.monotonic() - begin) < LATEST_S:
            while waiting and elapsed >= STAGGER_S * (len(NAMES) - len(waiting)):
                name = waiting.pop(0)
                ward.plug(name, devices[name])
            if not rebooted and elapsed >= REBOOT_S:
                rebooted = True
                devices[REBOOTED].reboot()
                screen.say(elapsed, f"{REBOOTED} loses power and starts again: it needs new turns")
            watcher.poll()
            screen.show(
                elapsed, watcher.statuses, watcher.changes, f"a ward of {len(NAMES)} devices; ends in about a minute"
            )
            if not told and watcher.all_tracking(len(NAMES)):
                told = True
                screen.say(elapsed, "all devices are calibrated and tracked")
            if elapsed >= END_S and watcher.all_tracking(len(NAMES)):
                return
            ward.check()
            time.sleep(0.1)


def _summary(
    console: Console, devices: dict[str, VirtualDevice], watcher: Watcher, subscribers: list[Subscriber], picture: Path
) -> bool:
    failures = []
    judgements = []
    for name in NAMES:
        status = watcher.statuses.get(name)
        found = None
        try:
            if status is not None:
                key = name, status.boot
                found = judge(devices[name], status.boot, subscribers[0].batches[key], watcher.raw[key], status)
        except LookupError as error:
            failures.append(f"{name}: {error}")
            continue
        if found is None:
            failures.append(f"{name} was not calibrated in its last boot")
        else:
            judgements.append(found)
            if not found.good:
                failures.append(f"{name}: {in_words(found)}")
    if len(watcher.raw) != len(NAMES) + 1:
        failures.append(f"{len(watcher.raw)} boots were seen; {len(NAMES) + 1} are expected")
    for shown in (_parameters(judgements), _worth(judgements)):
        console.print(shown)
        console.print()
    failures += _count(console, devices, subscribers)
    if judgements:
        picture.parent.mkdir(parents=True, exist_ok=True)
        figure.demo(judgements, picture)
        console.print(f"\nPicture: {picture}")
    for failure in failures:
        console.print(f"[red]failed:[/red] {failure}")
    if not failures:
        console.print("[green]The demo passed: every estimate agrees with the truth.[/green]")
    return not failures


def _parameters(judgements: list[Judgement]) -> Columns:
    spare = {"axis": 0, "k true": 2, "k found": 1, "error": 0, "bias true": 2, "found °/s": 1, "error °/s": 0}
    shown = Columns(
        [Column("device"), *(Column(heading, number=True, spare=n) for heading, n in spare.items())],
        title="Truth and estimate at the end of each device's last boot",
    )
    for j in judgements:
        for axis, name in enumerate(AXES):
            true, found = float(j.bias_true_dps[-1, axis]), float(j.bias_dps[-1, axis])
            k = f"{j.k_true[axis]:.4f}", f"{j.k[axis]:.4f}", f"{j.k[axis] - j.k_true[axis]:+.4f}"
            shown.add(j.device if axis == 0 else "", name, *k, f"{true:+.3f}", f"{found:+.3f}", f"{found - true:+.3f}")
    return shown


def _worth(judgements: list[Judgement]) -> Columns:
    columns = [Column("device"), *(Column(heading, number=True) for heading in ("over", "raw", "corrected"))]
    shown = Columns(columns, title="Heading error since calibration")
    for j in judgements:
        raw, corrected = f"{j.raw_heading_deg[-1]:+.1f}°", f"{j.corrected_heading_deg[-1]:+.2f}°"
        shown.add(j.device, f"{j.time[-1] - j.time[0]:.0f} s", raw, corrected)
    return shown


def _count(console: Console, devices: dict[str, VirtualDevice], subscribers: list[Subscriber]) -> list[str]:
    """Print samples sent against samples received by each subscriber, boot by boot; returns failures in words."""
    failures = []
    received_by = (Column(f"subscriber {n + 1}", number=True) for n in range(len(subscribers)))
    columns = [Column("device"), Column("boot", number=True, spare=1), Column("sent", number=True), *received_by]
    shown = Columns(columns, title="Samples sent and received")
    total = 0
    boots: list[Boot] = sorted({boot for subscriber in subscribers for boot in subscriber.received})
    for name, boot in boots:
        sent = devices[name].sent[boot]
        total += sent
        received = [subscriber.received[name, boot] for subscriber in subscribers]
        shown.add(name, f"{boot:016x}", str(sent), *map(str, received))
        if set(received) != {sent}:
            failures.append(f"{name}: {sent} samples sent, {received} received")
    console.print(shown)
    console.print(
        f"{total} samples sent, each received exactly once by {len(subscribers)} subscribers" if not failures else ""
    )
    failures += [f"a subscriber reports {s.troubles}" for s in subscribers if s.troubles]
    return failures
