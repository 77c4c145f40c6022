"""How much a recorder that is killed has lost: 100 of them, at random moments. `make bench`.

Seconds of what had been sent to the bus before the kill that are not in the recovered file; goal below 1 s, each time.
"""

import sys

import numpy as np
from rich.console import Console

from tests.bridge.recording.kills import killed

GOAL_S = 1.0


def main(rounds: int = 100, at_once: int = 4) -> int:
    """Print a line."""
    results = list(killed(rounds, at_once, "tcp/127.0.0.1:7543", seed=1, longest_s=4.0))
    lost = np.array([result.lost_s for result in results])
    within = sum(result.missing for result in results)
    Console().print(
        f"{len(results)} recorders killed: lost {np.median(lost):.2f} s in the median, {lost.max():.2f} s at worst "
        f"(goal {GOAL_S:g} s); {(lost >= GOAL_S).sum()} beyond it; {within} samples missing within"
    )
    return int((lost >= GOAL_S).any() or within)


if __name__ == "__main__":
    sys.exit(main(*(int(word) for word in sys.argv[1:])))
