"""Throughput, latency, CPU and memory for 1, 10, 100 and 1000 devices: relays that do ever more, and the estimator, in turn.

With --devices one run: what becomes of more than it can do.
Caches and the past that is kept for smoothing fill for five minutes: whether memory is flat after that tells
`--devices 1000 --warm 300 --seconds 600`, a quarter of an hour.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.bench.load.run import Load, Middle, Took, run

PACED = (
    *(Load(devices, rate_hz, batch) for rate_hz, batch in ((104.0, 10), (562.5, 56)) for devices in (1, 10, 100, 1000)),
    Load(100, batch=2),
)
QUICK = (Load(100, batch=2), Load(1000))
BURST = 60_000
#: what a thousand devices of 104 Hz may take of a core; to what a bare relay adds 100 devices in messages of 20 ms, s
CROWD, CORE = Load(1000), 0.5
QUICKEST, ADDED_P50_S, ADDED_P99_S = Load(100, batch=2), 0.0003, 0.0015
#: of the bare relay's messages, and samples a second; what memory may grow by once it is warm for so long, s
SHARE, SAMPLES_PER_S = 0.8, 1.5e6
FLAT, WARM_S = 0.02, 300.0


def main() -> int:
    """Print two tables; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two loads and one burst only")
    parser.add_argument("--json", action="store_true", help="print all that was measured as one JSON object, last")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each paced run")
    parser.add_argument("--warm", type=float, default=CROWD.warm_s, help="seconds before that")
    parser.add_argument("--bursts", type=int, default=3, help="how often each burst is made")
    parser.add_argument(
        "--devices", type=int, help="the estimator alone with so many at 104 Hz, such as are more than it can do"
    )
    args = parser.parse_args()
    console = Console(width=120)
    if args.devices:
        took = run(Load(args.devices, seconds=args.seconds, warm_s=args.warm), Middle.ESTIMATOR)
        console.print(
            f"{args.devices} devices for {args.seconds:g} s: {took.whole} of them lost nothing in the last 20 s;"
            f" CPU {100 * took.cpu:.0f} %, p99 {1e3 * took.p99_s:.0f} ms, {took.lost} samples lost,"
            f" RSS {took.warm_rss_mb:.0f} MB when warm, {took.rss_mb:.0f} at the end"
        )
        return _said(console, unreached({(Load(args.devices), Middle.ESTIMATOR): took}, args.warm))
    table = Table(title="Paced")
    for heading in (
        "devices",
        "Hz",
        "a message",
        "",
        "CPU %",
        "router %",
        "RSS MB warm",
        "at the end",
        "p50 ms",
        "p99 ms",
        "lost",
        "sender late ms",
    ):
        table.add_column(heading, justify="right")
    found: dict[tuple[Load, Middle], Took] = {}
    for load in QUICK if args.quick else PACED:
        paced = replace(load, seconds=args.seconds, warm_s=args.warm)
        for middle in Middle:
            took = found[load, middle] = run(paced, middle)
            table.add_row(*_words(paced, took, middle))
            console.print(f"{paced.devices} x {paced.rate_hz:g} Hz, {middle}: done", style="dim")
    console.print(table)
    missed, measured = unreached(found, args.warm), dict[str, Any](paced=_paced(found), bursts=[])
    bursts = Table(
        title=f"As fast as it goes: bursts of {BURST:,} messages of 10 samples, medians of {args.bursts}, in turn"
    )
    for heading in ("devices", *(f"{middle} k msg/s" for middle in Middle), "ratios", "M samples/s", "lost"):
        bursts.add_column(heading, justify="right")
    for devices in (100,) if args.quick else (10, 100, 1000):
        runs = [[run(Load(devices, burst=BURST), middle) for middle in Middle] for _ in range(args.bursts)]
        most = [median(took.messages_per_s for took in each) for each in zip(*runs, strict=True)]
        shares = ratios(runs)
        lost = sum(turn[-1].lost for turn in runs)
        measured["bursts"].append(
            {
                "devices": devices,
                "messages_per_s": dict(zip(Middle, most, strict=True)),
                "of_bare_relay": shares[-1],
                "lost": lost,
            }
        )
        bursts.add_row(
            str(devices),
            *(f"{each / 1e3:.1f}" for each in most),
            ", ".join(f"{share:.2f}" for share in shares),
            f"{most[-1] * 10 / 1e6:.2f}",
            str(lost),
        )
        if shares[-1] < SHARE:
            missed.append(f"{devices} devices: {shares[-1]:.2f} of the bare relay's messages (goal {SHARE:g})")
        if most[-1] * 10 < SAMPLES_PER_S:
            missed.append(f"{devices} devices: {most[-1] * 10 / 1e6:.2f} M samples/s (goal {SAMPLES_PER_S / 1e6:g})")
        if lost:
            missed.append(f"{devices} devices: {lost} samples of bursts lost (goal 0)")
    console.print(bursts)
    if args.json:
        print(json.dumps(measured | {"not_reached": missed}))
    return _said(console, missed)


def _paced(found: Mapping[tuple[Load, Middle], Took]) -> list[dict[str, Any]]:
    """Each paced run, beside the bare relay's of the same load."""
    return [
        {
            "devices": load.devices,
            "rate_hz": load.rate_hz,
            "batch": load.batch,
            "middle": middle,
            "cpu": took.cpu,
            "cpu_of_bare_relay": took.cpu / found[load, Middle.RELAY].cpu,
            "p50_ms": 1e3 * took.p50_s,
            "p50_added_ms": 1e3 * (took.p50_s - found[load, Middle.RELAY].p50_s),
            "p99_ms": 1e3 * took.p99_s,
            "lost": took.lost,
            "rss_mb": took.rss_mb,
        }
        for (load, middle), took in found.items()
    ]


def ratios(runs: Sequence[Sequence[Took]]) -> list[float]:
    """Messages a second of all but the first of a turn, beside the first of the same turn: medians over the turns."""
    return [
        median(took.messages_per_s / bare.messages_per_s for bare, took in pairs)
        for pairs in zip(*([(turn[0], took) for took in turn[1:]] for turn in runs), strict=True)
    ]


def unreached(found: Mapping[tuple[Load, Middle], Took], warm_s: float) -> list[str]:
    """Which goals the estimator missed, of those that were tried, each after so long."""
    missed = []
    for (load, middle), took in found.items():
        if middle is not Middle.ESTIMATOR:
            continue
        what = f"{load.devices} x {load.rate_hz:g} Hz"
        if took.lost:
            missed.append(f"{what}: {took.lost} samples lost (goal 0)")
        if load == CROWD and took.cpu > CORE:
            missed.append(f"{what}: {100 * took.cpu:.0f} % of a core (goal {100 * CORE:g})")
        if warm_s >= WARM_S and took.rss_mb > (1 + FLAT) * took.warm_rss_mb:
            missed.append(f"{what}: memory grew from {took.warm_rss_mb:.0f} to {took.rss_mb:.0f} MB (goal {FLAT:.0%})")
        if load == QUICKEST and (bare := found.get((load, Middle.RELAY))):
            added = (("p50", took.p50_s - bare.p50_s, ADDED_P50_S), ("p99", took.p99_s - bare.p99_s, ADDED_P99_S))
            missed += [
                f"{what}: {which} {1e3 * more_s:.2f} ms after the bare relay's (goal {1e3 * goal_s:g})"
                for which, more_s, goal_s in added
                if more_s > goal_s
            ]
    return missed


def _said(console: Console, missed: list[str]) -> int:
    if missed:
        console.print(f"not reached: {'; '.join(missed)}")
    return int(bool(missed))


def _words(load: Load, took: Took, middle: Middle) -> list[str]:
    return [
        str(load.devices),
        f"{load.rate_hz:g}",
        str(load.batch),
        middle,
        f"{100 * took.cpu:.1f}",
        f"{100 * took.router_cpu:.1f}",
        f"{took.warm_rss_mb:.0f}",
        f"{took.rss_mb:.0f}",
        f"{1e3 * took.p50_s:.2f}",
        f"{1e3 * took.p99_s:.2f}",
        str(took.lost),
        f"{1e3 * took.sender_late_s:.0f}",
    ]


if __name__ == "__main__":
    sys.exit(main())
