"""Throughput, latency, CPU and memory for 1, 10, 100 and 1000 devices: relays that do ever more, and the estimator, in turn.

Writes out/load.png: how all of it grows with the number of devices. With --devices one run: what becomes of more than it can do.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from estimator import figures
from tests.bench.load.run import Load, Middle, Took, run

PACED = (
    *(Load(devices, rate_hz, batch) for rate_hz, batch in ((104.0, 10), (562.5, 56)) for devices in (1, 10, 100, 1000)),
    Load(100, batch=2),
)
QUICK = (Load(100, batch=2), Load(1000))
BURST = 60_000
OUT = Path("out/load.png")


def main() -> int:
    """Print two tables; no verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two loads and one burst only")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each paced run")
    parser.add_argument("--bursts", type=int, default=3, help="how often each burst is made")
    parser.add_argument(
        "--devices", type=int, help="the estimator alone with so many at 104 Hz, such as are more than it can do"
    )
    args = parser.parse_args()
    console = Console(width=120)
    if args.devices:
        took = run(Load(args.devices, seconds=args.seconds), Middle.ESTIMATOR)
        console.print(
            f"{args.devices} devices for {args.seconds:g} s: {took.whole} of them lost nothing in the last 20 s;"
            f" CPU {100 * took.cpu:.0f} %, p99 {1e3 * took.p99_s:.0f} ms"
        )
        return 0
    table = Table(title="Paced")
    for heading in (
        "devices",
        "Hz",
        "a message",
        "",
        "CPU %",
        "router %",
        "RSS MB",
        "p50 ms",
        "p99 ms",
        "lost",
        "sender late ms",
    ):
        table.add_column(heading, justify="right")
    found: dict[tuple[Load, Middle], Took] = {}
    for load in QUICK if args.quick else PACED:
        paced = Load(load.devices, load.rate_hz, load.batch, args.seconds)
        for middle in Middle:
            took = found[load, middle] = run(paced, middle)
            table.add_row(*_words(paced, took, middle))
            console.print(f"{paced.devices} x {paced.rate_hz:g} Hz, {middle}: done", style="dim")
    console.print(table)
    bursts = Table(title=f"As fast as it goes: bursts of {BURST:,} messages of 10 samples, best of {args.bursts}")
    for heading in ("devices", *(f"{middle} k msg/s" for middle in Middle), "ratios", "M samples/s", "lost"):
        bursts.add_column(heading, justify="right")
    for devices in (100,) if args.quick else (10, 100, 1000):
        runs = [[run(Load(devices, burst=BURST), middle) for _ in range(args.bursts)] for middle in Middle]
        most = [max(took.messages_per_s for took in each) for each in runs]
        bursts.add_row(
            str(devices),
            *(f"{each / 1e3:.1f}" for each in most),
            ", ".join(f"{each / most[0]:.2f}" for each in most[1:]),
            f"{most[-1] * 10 / 1e6:.2f}",
            str(sum(took.lost for took in runs[-1])),
        )
    console.print(bursts)
    if not args.quick:
        _draw(found)
        console.print(f"drawn: {OUT}")
    return 0


def _draw(found: dict[tuple[Load, Middle], Took]) -> None:
    numbers = sorted({load.devices for load in PACED})
    cpu, latency = dict[str, list[float]](), dict[str, list[float]]()
    for rate_hz, batch in dict.fromkeys((load.rate_hz, load.batch) for load in PACED if load.devices == 1):
        for middle in reversed(Middle):
            took = [found[Load(devices, rate_hz, batch), middle] for devices in numbers]
            cpu[f"{middle}, {rate_hz:g} Hz"] = [100 * each.cpu for each in took]
            latency[f"{middle}, {rate_hz:g} Hz"] = [1e3 * each.p99_s for each in took]
    panels = [
        figures.Curves(title, "devices", np.array(numbers, float), {k: np.array(v) for k, v in values.items()}, goal)
        for title, values, goal in (("% of a core", cpu, 50.0), ("ms, 99 % of latency", latency, None))
    ]
    OUT.parent.mkdir(exist_ok=True)
    figures.curves(panels, "What an estimator takes of its machine, beside a bare relay", OUT)


def _words(load: Load, took: Took, middle: Middle) -> list[str]:
    return [
        str(load.devices),
        f"{load.rate_hz:g}",
        str(load.batch),
        middle,
        f"{100 * took.cpu:.1f}",
        f"{100 * took.router_cpu:.1f}",
        f"{took.rss_mb:.0f}",
        f"{1e3 * took.p50_s:.2f}",
        f"{1e3 * took.p99_s:.2f}",
        str(took.lost),
        f"{1e3 * took.sender_late_s:.0f}",
    ]


if __name__ == "__main__":
    sys.exit(main())
