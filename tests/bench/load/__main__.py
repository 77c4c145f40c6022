"""Throughput, latency, CPU and memory of the estimator for 1, 10, 100 and 1000 devices, each beside a bare relay.

With --devices one run of the estimator alone: what becomes of more than it can do; and, with `--warm 300 --seconds 600`, whether
memory is flat once caches and the past that is kept for smoothing are full.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from statistics import median
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.bench.load.run import Load, run

Figures = dict[str, Any]
CROWD, QUICKEST = Load(1000), Load(100, batch=2)
PACED = (
    *(Load(devices, rate_hz, batch) for rate_hz, batch in ((104.0, 10), (562.5, 56)) for devices in (1, 10, 100, 1000)),
    QUICKEST,
)
BURST = 60_000
#: at most: processor time of a bare relay's, ms; at least: messages a second of a bare relay's
GOALS = {CROWD: {"cpu_of_bare_relay": 2.2, "p99_ms": 150.0}, QUICKEST: {"cpu_of_bare_relay": 1.8, "p50_added_ms": 0.5}}
BURST_OF_BARE_RELAY = 0.5


def paced(load: Load, seconds: float, warm_s: float) -> Figures:
    """The figures of one load, the estimator's beside a bare relay's."""
    now = replace(load, seconds=seconds, warm_s=warm_s)
    bare, took = run(now, relay=True), run(now)
    return {
        "devices": load.devices,
        "rate_hz": load.rate_hz,
        "batch": load.batch,
        "cpu": took.cpu,
        "cpu_of_bare_relay": took.cpu / bare.cpu,
        "router_cpu": took.router_cpu,
        "p50_ms": 1e3 * took.p50_s,
        "p50_added_ms": 1e3 * (took.p50_s - bare.p50_s),
        "p99_ms": 1e3 * took.p99_s,
        "p99_added_ms": 1e3 * (took.p99_s - bare.p99_s),
        "lost": took.lost,
        "warm_rss_mb": took.warm_rss_mb,
        "rss_mb": took.rss_mb,
        "sender_late_ms": 1e3 * took.sender_late_s,
    }


def burst(devices: int, times: int) -> Figures:
    """As many messages of ten samples at once as BURST: medians of several, by turns with a bare relay."""
    turns = [(run(Load(devices, burst=BURST), relay=True), run(Load(devices, burst=BURST))) for _ in range(times)]
    return {
        "devices": devices,
        "messages_per_s": median(took.messages_per_s for _, took in turns),
        "of_bare_relay": median(took.messages_per_s / bare.messages_per_s for bare, took in turns),
        "lost": sum(took.lost for _, took in turns),
    }


def unreached(of_loads: list[tuple[Load, Figures]], bursts: list[Figures]) -> Iterator[str]:
    """Which goals were missed."""
    for load, found in of_loads:
        what = f"{load.devices} x {load.rate_hz:g} Hz"
        for name, most in {**GOALS.get(load, {}), "lost": 0}.items():
            if found[name] > most:
                yield f"{what}: {name} {found[name]:.4g} (goal {most:g})"
    for found in bursts:
        if found["of_bare_relay"] < BURST_OF_BARE_RELAY or found["lost"]:
            share, lost = found["of_bare_relay"], found["lost"]
            yield f"burst of {found['devices']} devices: {share:.2f} of a bare relay (goal 0.5), {lost} lost (goal 0)"


def shown(title: str, rows: list[Figures]) -> Table:
    """All figures, a column each."""
    table = Table(title=title)
    for heading in rows[0]:
        table.add_column(heading.replace("_", " "), justify="right")
    for row in rows:
        table.add_row(*(f"{value:.4g}" for value in row.values()))
    return table


def main() -> int:
    """Print two tables; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two loads and one burst only")
    parser.add_argument("--json", action="store_true", help="print all that was measured as one JSON object, last")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each paced run")
    parser.add_argument("--warm", type=float, default=CROWD.warm_s, help="seconds before that")
    parser.add_argument("--bursts", type=int, default=3, help="how often each burst is made")
    parser.add_argument("--devices", type=int, help="the estimator alone with so many at 104 Hz")
    args = parser.parse_args()
    console = Console(width=160)
    if args.devices:
        took = run(Load(args.devices, seconds=args.seconds, warm_s=args.warm))
        console.print(
            f"{args.devices} devices for {args.seconds:g} s: {took.whole} of them lost nothing in the last 20 s;"
            f" CPU {100 * took.cpu:.0f} %, p99 {1e3 * took.p99_s:.0f} ms, {took.lost} samples lost,"
            f" RSS {took.warm_rss_mb:.0f} MB when warm, {took.rss_mb:.0f} at the end"
        )
        return int(took.lost > 0)
    loads = (QUICKEST, CROWD) if args.quick else PACED
    of_loads = [(load, paced(load, args.seconds, args.warm)) for load in loads]
    bursts = [burst(devices, args.bursts) for devices in ((100,) if args.quick else (10, 100, 1000))]
    console.print(shown("Paced", [found for _, found in of_loads]))
    console.print(shown(f"As fast as it goes: {BURST:,} messages", bursts))
    missed = list(unreached(of_loads, bursts))
    if args.json:
        print(json.dumps({"paced": [found for _, found in of_loads], "bursts": bursts, "not_reached": missed}))
    if missed:
        console.print(f"not reached: {'; '.join(missed)}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
