"""Seeds one after the other, each with what was done and what was broken. `make nemesis`, `python -m tests.nemesis --help`."""

import argparse
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path

from rich.console import Console

from estimator.kernels.compiled import ready
from tests.nemesis.clock import Clock
from tests.nemesis.run import run


def main() -> int:
    """1 when a promise was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--devices", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=40.0, help="of faults, in each run")
    parser.add_argument("--estimators", type=int, help="1, and with every second seed 3, where it is not said")
    parser.add_argument("--routers", type=int, help="1, and with every second seed 2, where it is not said")
    args = parser.parse_args()
    console = Console(soft_wrap=True)
    ready()  # a first compilation takes longer than a ward may need to start
    # However it is ended, the ward it has begun ends with it.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda got, _: sys.exit(128 + got))
    with tempfile.TemporaryDirectory() as folder:
        if Clock.found(Path(folder)) is None:
            console.print("No clocks are set: libfaketime is not installed (Debian: apt-get install libfaketime)")
    failed, did = 0, Counter[str]()
    for seed in range(args.first, args.first + args.seeds):
        estimators = args.estimators or (1, 3)[seed % 2]
        routers = args.routers or (1, 2)[seed % 2]
        result = run(seed, args.devices, args.seconds, estimators, routers)
        did.update(result.sorts)
        console.print(
            f"seed {seed}: {len(result.faults)} faults, {result.samples:,} samples, "
            f"{result.good / max(1, result.samples):.0%} GOOD, {result.missing:,} told missing, "
            f"{result.calibrations} calibrations: {'broken' if result.broken else 'all kept'}",
            style="red" if result.broken else None,
        )
        if result.broken:
            failed += 1
            for line in (*(f"  did: {fault}" for fault in result.faults), *(f"  BROKEN: {w}" for w in result.broken)):
                console.print(line, markup=False)
            console.print(
                f"  again: python -m tests.nemesis --first {seed} --seeds 1 --devices {args.devices} "
                f"--estimators {estimators} --routers {routers} --seconds {args.seconds:g}; "
                f"its logs are in {result.folder}"
            )
    console.print("done: " + ", ".join(f"{sort} {count}" for sort, count in sorted(did.items())), markup=False)
    console.print(f"{args.seeds - failed} of {args.seeds} kept every promise")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
