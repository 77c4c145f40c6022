"""How long a killed estimator takes to be back: 200 of them, at random moments under load. `make bench-faults`.

Seconds from the start of the new process to the first GOOD corrected sample at a subscriber, of any device (goal 2 s), and
beside them to that of the last device; what was not gone on with: calibration, bias and how surely it is known, samples,
acknowledged calibrations, the store.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console

from tests.ward.killed import HEARD_S, Kill, killed

GOAL_S = 2.0


def main() -> int:
    """Print what was found; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--steady", type=int, default=20, help="devices in the bridge")
    parser.add_argument("--restless", type=int, default=2, help="devices that are rebooted and calibrated all the time")
    parser.add_argument("--away", type=float, default=HEARD_S, help="seconds until it is started again")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    console = Console()
    kills: list[Kill] = []
    with tempfile.TemporaryDirectory() as folder:
        for kill in killed(Path(folder), args.kills, args.steady, args.restless, args.seed, away_s=args.away):
            kills.append(kill)
            for fault in kill.faults:
                console.print(f"kill {len(kills)}: {fault}", style="red")
            if len(kills) % 10 == 1:
                console.print(
                    f"{len(kills)} of {args.kills}: {kill.first_s:.2f} s, all {kill.all_s:.2f} s", style="dim"
                )
    first, every = np.array([k.first_s for k in kills]), np.array([k.all_s for k in kills])
    for what, seconds, goal in (
        ("the first GOOD sample", first, f" (goal {GOAL_S:g} s)"),
        (f"the last of {args.steady} devices' first", every, ""),
    ):
        p50, p95 = np.percentile(seconds, (50, 95))
        console.print(f"{what}: median {p50:.2f} s, p95 {p95:.2f} s, worst {seconds.max():.2f} s{goal}")
    spent = np.array([kill.cpu_s for kill in kills])
    console.print(
        f"processor time until the first GOOD sample: median {np.median(spent):.2f} s, worst {spent.max():.2f} s"
    )
    console.print(f"threads of the estimator: {max(kill.threads for kill in kills)}")
    moved = np.concatenate([kill.moved for kill in kills])
    console.print(
        f"the bias is where it was within its standard deviation: {(moved <= 1).mean():.1%}; "
        f"median {np.median(moved):.2f}, p99 {np.percentile(moved, 99):.2f} of it"
    )
    faults = sum(len(kill.faults) for kill in kills)
    console.print(
        f"{len(kills)} kills, {faults} faults, {(first > GOAL_S).sum()} beyond the goal; "
        f"{(every > GOAL_S).sum()} where the last device took longer than that"
    )
    return int(bool(faults or (first > GOAL_S).any()))


if __name__ == "__main__":
    sys.exit(main())
