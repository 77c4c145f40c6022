"""Throughput, latency, CPU and memory for 1, 10, 100 and 1000 devices, the estimator and a bare relay in turn."""

import argparse
import sys

from rich.console import Console
from rich.table import Table

from tests.bench.load.run import Load, Took, run

PACED = (Load(1), Load(10), Load(100), Load(1000), Load(100, 562.5, 28), Load(1000, 562.5, 56))
QUICK = (Load(100, batch=2), Load(1000))
BURST = 60_000


def main() -> int:
    """Print two tables; no verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two loads and one burst only")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each paced run")
    parser.add_argument("--bursts", type=int, default=3, help="how often each burst is made")
    args = parser.parse_args()
    console = Console()
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
    for load in QUICK if args.quick else PACED:
        paced = Load(load.devices, load.rate_hz, load.batch, args.seconds)
        for relay in (True, False):
            table.add_row(*_words(paced, run(paced, relay=relay), relay=relay))
            console.print(
                f"{paced.devices} x {paced.rate_hz:g} Hz, {'relay' if relay else 'estimator'}: done", style="dim"
            )
    console.print(table)
    bursts = Table(title=f"As fast as it goes: bursts of {BURST:,} messages of 10 samples, best of {args.bursts}")
    for heading in ("devices", "relay k msg/s", "estimator k msg/s", "ratio", "M samples/s", "lost"):
        bursts.add_column(heading, justify="right")
    for devices in (100,) if args.quick else (10, 100, 1000):
        relayed, corrected = (
            [run(Load(devices, burst=BURST), relay=relay) for _ in range(args.bursts)] for relay in (True, False)
        )
        most = [max(took.messages_per_s for took in each) for each in (relayed, corrected)]
        bursts.add_row(
            str(devices),
            f"{most[0] / 1e3:.1f}",
            f"{most[1] / 1e3:.1f}",
            f"{most[1] / most[0]:.2f}",
            f"{most[1] * 10 / 1e6:.2f}",
            str(sum(took.lost for took in corrected)),
        )
    console.print(bursts)
    return 0


def _words(load: Load, took: Took, *, relay: bool) -> list[str]:
    return [
        str(load.devices),
        f"{load.rate_hz:g}",
        str(load.batch),
        "relay" if relay else "estimator",
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
