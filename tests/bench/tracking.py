"""Bias trackers side by side on real movement, on simulated days and in slow turns. `make bench-tracking`.

The column "true bias" is what the truth itself comes to; "optics" is a filter that sees the optical orientation in place of
the accelerometer, in real time and through the matrix of the very trial: what no method can hope for. "truerate unpushed" is this
project's own, in real time, with an accelerometer that reads gravity as optics has it: what it could do if nothing pushed.
Writes out/tracking.json. --hours and --days make the days shorter and fewer.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.bench import broad
from tests.bench.cases import DRIFT, KEPT, LIMITS, ROWS, Case, Row, broad_cases, day_cases, turn_cases
from tests.bench.trackers import TRACKERS, Track

TRUTH = "true bias"
SHOWN_FOR_TRUTH = {row.name for row in ROWS if row.group in (KEPT, DRIFT)}
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
        found = {limit: track() for limit, track in case.limits.items()}
        for method in TRACKERS:
            found[method] = tracked(method, case)
            progress.advance(task)
        for method, track in found.items():
            for row, worth in (case.judge(track) if track is not None else {}).items():
                results[row][method][case.name] = worth


def tracked(method: str, case: Case) -> Track | None:
    """What a method makes of a case."""
    return TRACKERS[method](case.gyro, case.accel, case.temperature_c, case.rate_hz, case.prior)


def tables(results: Results) -> Iterator[Table]:
    """One a group: scenarios down, methods and goals across."""
    for group in dict.fromkeys(row.group for row in ROWS if results[row.name]):
        title = f"{group}: mean (furthest off)" if group == KEPT else group
        shown = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
        shown.add_column("", width=22, no_wrap=True)
        for heading in (*TRACKERS, TRUTH, *LIMITS, "goal", "goal smoothed"):
            shown.add_column(heading.replace(" ", "\n", 1), justify="right", width=9, no_wrap=True)
        for row in ROWS:
            if row.group == group and results[row.name]:
                found = {method: list(of.values()) for method, of in results[row.name].items()}
                cells = [written(row, found.get(method)) for method in (*TRACKERS, TRUTH, *LIMITS)]
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
    shown = f"{row.summary(values):.{4 if row.unit == '°/s' else 2 if row.median else 0}f}"
    return shown if furthest is None else f"{shown} ({furthest:.0f})"


def written_out(results: Results, path: Path) -> None:
    """Every case of every method, and the goals."""
    rows = [
        {
            "row": row.name,
            "group": row.group,
            "unit": row.unit,
            "goal": None if np.isnan(row.goal) else row.goal,
            "goal_smoothed": None if np.isnan(row.goal_smoothed) else row.goal_smoothed,
            "statistic": "median" if row.median else "mean",
            "methods": {
                method: {
                    "summary": row.summary(values := list(of.values())),
                    "furthest": row.furthest(values),
                    "cases": of,
                }
                for method, of in results[row.name].items()
            },
        }
        for row in ROWS
        if results[row.name]
    ]
    path.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--hours", type=float, default=8.0, help="of each day")
    asked.add_argument("--days", type=int, default=3, help="of each kind; 0 for none")
    asked.add_argument("--out", type=Path, default=Path("out"))
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
    wanted.out.mkdir(parents=True, exist_ok=True)
    written_out(results, wanted.out / "tracking.json")
    console.print(f"{wanted.out / 'tracking.json'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
