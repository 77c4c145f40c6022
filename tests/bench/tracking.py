"""Bias trackers side by side on real movement, on simulated days and in slow turns. `make bench-tracking`.

The column "true bias" is what the truth itself comes to.
--hours and --days make the days shorter and fewer.
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench import broad
from tests.bench.cases import ERROR, KEPT, ROWS, Case, Row, broad_cases, day_cases, turn_cases
from tests.bench.trackers import TRACKERS, Track

TRUTH = "true bias"
SHOWN_FOR_TRUTH = {row.name for row in ROWS if row.group == KEPT}
_WIDTH = 138

#: row, method, values of its cases by name
Results = dict[str, dict[str, dict[str, float]]]


def measure(cases: Iterable[Case], n: int, progress: Progress, what: str, results: Results) -> None:
    """Run every method on each of n cases."""
    task = progress.add_task(what, total=n * len(TRACKERS), visible=n > 0)
    for case in cases:
        for row, worth in case.judge(Track(case.bias)).items():
            if row in SHOWN_FOR_TRUTH:
                results[row][TRUTH][case.name] = worth
        for method, tracker in TRACKERS.items():
            track = tracker(case.gyro, case.accel, case.temperature_c, case.rate_hz, case.prior)
            progress.advance(task)
            for row, worth in (case.judge(track) if track is not None else {}).items():
                results[row][method][case.name] = worth


def tables(results: Results) -> Iterator[Table]:
    """One a group: scenarios down, methods and goals across."""
    for group in dict.fromkeys(row.group for row in ROWS if results[row.name]):
        title = f"{group}: mean (furthest off)" if group == KEPT else group
        shown = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
        shown.add_column("", width=22, no_wrap=True)
        for heading in (*TRACKERS, TRUTH, "goal", "goal smoothed"):
            shown.add_column(heading.replace(" ", "\n", 1), justify="right", width=9, no_wrap=True)
        for row in ROWS:
            if row.group == group and results[row.name]:
                found = {method: list(of.values()) for method, of in results[row.name].items()}
                cells = [written(row, found.get(method)) for method in (*TRACKERS, TRUTH)]
                shown.add_row(
                    row.label,
                    *cells,
                    *("–" if np.isnan(goal) else f"{goal:g}" for goal in (row.goal, row.goal_smoothed)),
                )
        yield shown


def written(row: Row, values: list[float] | None) -> str:
    """What the cases of a row come to."""
    if not values:
        return "–"
    furthest = row.furthest(values)
    shown = f"{np.mean(values):.{4 if row.group == ERROR else 0}f}"
    return shown if furthest is None else f"{shown} ({furthest:.0f})"


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--hours", type=float, default=8.0, help="of each day")
    asked.add_argument("--days", type=int, default=3, help="of each kind; 0 for none")
    wanted = asked.parse_args()
    console = Console()
    console.width = max(console.width, _WIDTH)
    results: Results = {row.name: defaultdict(dict) for row in ROWS}
    if not broad.FOLDER.is_dir():
        console.print(f"BROAD is not there ({broad.FOLDER}): left out", style="yellow")
    with Progress(console=console) as progress:
        turns, trials = list(turn_cases()), list(broad_cases())
        measure(turns, len(turns), progress, "slow turns", results)
        measure(trials, len(trials), progress, "BROAD", results)
        measure(day_cases(wanted.days, wanted.hours), 3 * wanted.days, progress, "ward days", results)
    for shown in tables(results):
        console.print(shown)
    return 0


if __name__ == "__main__":
    sys.exit(main())
