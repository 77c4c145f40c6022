"""`truerate demo`: the ward boots, is turned, calibrates and tracks; one device reboots; then it is judged."""

import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from estimator import figures
from estimator.demo.audience import Boot, Subscriber, Watcher
from estimator.demo.judge import Judgement, in_words, judge
from estimator.demo.ward import WARD, DemoFailed, Ward, wait_for
from estimator.screen import Screen, table

NAMES = ("ankle-left", "ankle-right", "back", "chest", "wrist-left", "wrist-right")
REBOOTED = "chest"
START_S, STAGGER_S, REBOOT_S, END_S, LATEST_S = 20.0, 0.4, 32.0, 66.0, 80.0
SUBSCRIBERS = 3


def run(console: Console, picture: Path, seed: int) -> bool:
    """Run the demonstration and leave a picture; whether the ward came out right."""
    with Ward(list(NAMES), seed) as ward:
        console.print(f"Starting router, bridge and estimator as processes; their logs are in {ward.folder}")
        ward.start_processes()
        if not wait_for(ward.endpoint, START_S):
            ward.check()
            raise DemoFailed(f"the router does not listen on {ward.endpoint} after {START_S:.0f} s")
        subscribers = [Subscriber(ward.endpoint, WARD, keep=number == 0) for number in range(SUBSCRIBERS)]
        watcher = Watcher(ward.endpoint, WARD)
        try:
            _live(console, ward, watcher)
            for device in ward.devices.values():
                device.power_off()
            time.sleep(1.0)
            watcher.poll()
        finally:
            for subscriber in subscribers:
                subscriber.close()
            watcher.close()
        console.print(table(watcher.statuses, "The ward at the end"))
        console.print()
        return _summary(console, ward, watcher, subscribers, picture)


def _live(console: Console, ward: Ward, watcher: Watcher) -> None:
    begin = time.monotonic()
    waiting, rebooted, told = list(NAMES), False, False
    with Screen(console) as screen:
        while (elapsed := time.monotonic() - begin) < LATEST_S:
            while waiting and elapsed >= STAGGER_S * (len(NAMES) - len(waiting)):
                ward.plug(waiting.pop(0))
            if not rebooted and elapsed >= REBOOT_S:
                rebooted = True
                ward.devices[REBOOTED].reboot()
                screen.say(elapsed, f"{REBOOTED} loses power and starts again: it must be turned once more")
            watcher.poll()
            if not told and watcher.all_tracking(len(NAMES)):
                told = True
                screen.say(elapsed, "all devices are calibrated and tracked")
            screen.show(
                elapsed, watcher.statuses, watcher.changes, f"a ward of {len(NAMES)}; ends by itself in about a minute"
            )
            if elapsed >= END_S and watcher.all_tracking(len(NAMES)):
                return
            ward.check()
            time.sleep(0.1)


def _summary(console: Console, ward: Ward, watcher: Watcher, subscribers: list[Subscriber], picture: Path) -> bool:
    failures = []
    judgements = []
    for name in NAMES:
        status = watcher.statuses.get(name)
        found = None
        if status is not None:
            key = name, status.boot
            found = judge(ward.devices[name], status.boot, subscribers[0].batches[key], watcher.raw[key], status)
        if found is None:
            failures.append(f"{name} was not calibrated in its last boot")
        else:
            judgements.append(found)
            if not found.good:
                failures.append(f"{name}: {in_words(found)}")
    if len(watcher.raw) != len(NAMES) + 1:
        failures.append(f"{len(watcher.raw)} boots were seen, {len(NAMES) + 1} happened")
    console.print(_parameters(judgements))
    console.print()
    failures += _count(console, ward, subscribers)
    if judgements:
        picture.parent.mkdir(parents=True, exist_ok=True)
        figures.demo(judgements, picture)
        console.print(f"\nPicture: {picture}")
    for failure in failures:
        console.print(f"[red]not right:[/red] {failure}")
    if not failures:
        console.print("[green]The ward came out right.[/green]")
    return not failures


def _parameters(judgements: list[Judgement]) -> Table:
    shown = Table(
        title="Truth and estimate, at the end of the last boot", title_justify="left", box=None, pad_edge=False
    )
    for heading in (
        "device",
        "k true",
        "k estimated",
        "k error",
        "bias true °/s",
        "bias estimated",
        "what it was worth",
    ):
        shown.add_column(heading, no_wrap=True)
    for j in judgements:
        columns = (
            (j.k_true, ".4f"),
            (j.k, ".4f"),
            (j.k - j.k_true, "+.4f"),
            (j.bias_true_dps[-1], "+.3f"),
            (j.bias_dps[-1], "+.3f"),
        )
        shown.add_row(j.device, *(" ".join(f"{v:{form}}" for v in values) for values, form in columns), in_words(j))
    return shown


def _count(console: Console, ward: Ward, subscribers: list[Subscriber]) -> list[str]:
    """Samples sent against samples received by each subscriber, boot by boot; what is wrong, in words."""
    failures = []
    shown = Table(title="Samples sent and received", title_justify="left", box=None, pad_edge=False)
    for heading in ("device", "boot", "sent", *(f"subscriber {n + 1}" for n in range(len(subscribers)))):
        shown.add_column(heading, justify="left" if heading in ("device", "boot") else "right")
    total = 0
    boots: list[Boot] = sorted({boot for subscriber in subscribers for boot in subscriber.received})
    for name, boot in boots:
        sent = ward.devices[name].sent(boot)
        total += sent
        received = [subscriber.received[name, boot] for subscriber in subscribers]
        shown.add_row(name, f"{boot:016x}", str(sent), *map(str, received))
        if set(received) != {sent}:
            failures.append(f"{name}: {sent} samples sent, {received} received")
    console.print(shown)
    console.print(
        f"{total} samples sent, each received exactly once by {len(subscribers)} subscribers" if not failures else ""
    )
    failures += [f"a subscriber reports {s.troubles}" for s in subscribers if s.troubles]
    return failures
