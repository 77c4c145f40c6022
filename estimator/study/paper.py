"""The paper's simulation: Algorithm 1 and closure on the same thousands of sessions, against truth and what is possible.

Thirty parameter sets, each turned many times, at each level of noise. The paper's gyro has a constant bias and its hand
puts the device back exactly, so the closure calibration is told so; with a re-placement error it is told its size.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from bridge.columns import Column, Columns
from bridge.toml_file import ConfigError
from estimator import figures
from estimator.study.paper_runs import Errors, Scenario, compute

#: the paper's words: at this noise, °/s, most parameter errors (k, and bias in °/s) lie within
BANDS = {0.03: 5.5e-3, 0.15: 2.5e-2}
METHODS = ("algorithm1", "closure")
PARTS = {"k": slice(3, 6), "bias °/s": slice(0, 3)}


@dataclass(frozen=True, slots=True)
class Row:
    """One method, one noise (°/s), scale factors or biases (°/s): error and the best possible, rms over runs and axes.

    inside: share of errors within the paper's band, None without one. nees: of bias and k together, over its 6 degrees of
    freedom, None without a covariance; honest is 1, and within nees_band of it in 95 % of studies. test: rms error of
    corrected rates over that of the readings, of the median run, on a test set (the paper: at most 3 % at 0.03 °/s).
    """

    noise_dps: float
    method: str
    parameter: str
    rms: float
    bound: float
    median: float
    largest: float
    inside: float | None
    nees: float | None
    nees_band: float
    test: float


def tabulate(errors: dict[float, Errors]) -> list[Row]:
    """The rows of a study."""
    return [
        _row(noise, method, name, found, found.error[number])
        for noise, found in errors.items()
        for number, method in enumerate(METHODS)
        for name in PARTS
    ]


def _row(noise: float, method: str, name: str, found: Errors, errors: Any) -> Row:
    error, limit = errors[:, PARTS[name]], BANDS.get(noise)
    return Row(
        noise_dps=noise,
        method=method,
        parameter=name,
        rms=float(np.sqrt(np.mean(error**2))),
        bound=float(np.sqrt(found.bound[:, PARTS[name]].mean())),
        median=float(np.median(error)),
        largest=float(np.abs(error).max()),
        inside=None if limit is None else float(np.mean(np.abs(error) < limit)),
        nees=float(found.nees.mean() / 6) if method == "closure" else None,
        nees_band=float(1.96 * np.sqrt(2 / (6 * len(found.nees)))),
        test=float(np.median(found.test[METHODS.index(method)])),
    )


def run(console: Console, scenario: Scenario, workers: int | None, picture: Path) -> None:
    """Compute with progress shown; print the table; leave the picture, and beside it the table as JSON.

    Raises ConfigError, before it begins, where that would take the place of another file.
    """

    def progress(done: Iterable[Any], total: int) -> Iterable[Any]:
        return track(done, "simulating and calibrating", total=total, console=console, transient=True)

    beside = _beside(picture)
    errors = compute(scenario, workers, progress)
    rows = tabulate(errors)
    console.print(
        f"The paper's simulation: {scenario.runs} sessions at each noise, wobble {scenario.wobble_deg:g}°, "
        f"re-placement {scenario.replacement_deg:g}° per axis, seed {scenario.seed}",
        highlight=False,
    )
    console.print(_table(rows))
    honest = f"NEES per degree of freedom of an honest covariance: 1 ± {rows[0].nees_band:.3f} in 95 % of such studies"
    bands = ", ".join(f"±{band:g} at {noise:g} °/s" for noise, band in BANDS.items())
    console.print(f"{honest}. The paper's bands: {bands}.", highlight=False)
    console.print(
        "Left: error of corrected rates over that of readings on a test set; the paper: ≤ 3 % at 0.03 °/s",
        highlight=False,
    )
    picture.parent.mkdir(parents=True, exist_ok=True)
    report = {"scenario": asdict(scenario), "rows": [asdict(row) for row in rows]}
    unfinished = beside.with_name(f".{beside.name}.part")
    try:
        unfinished.write_text(json.dumps(report, indent=1) + "\n")
        unfinished.replace(beside)
    finally:
        unfinished.unlink(missing_ok=True)
    panels = []
    for noise, found in errors.items():
        for name, part, unit in (
            ("scale factor k", slice(3, 6), "|error| of k"),
            ("bias", slice(0, 3), "|error|, °/s"),
        ):
            size = {m: np.abs(e[:, part]) for m, e in zip(("Algorithm 1", "closure"), found.error, strict=True)}
            lines = {"Cramér-Rao bound, rms": float(np.sqrt(found.bound[:, part].mean()))}
            if noise in BANDS:
                lines["the paper's band"] = BANDS[noise]
            panels.append(figures.Boxes(f"{name}, noise {noise:g} °/s", unit, size, lines))
    figures.boxes(
        panels, f"Errors in {scenario.runs} simulated sessions: half in the box, 95 % below the upper whisker", picture
    )
    console.print(f"Picture: {picture}", highlight=False)


def _beside(picture: Path) -> Path:
    """Where the table goes as JSON; raises ConfigError where something is there that is none."""
    path = picture.with_suffix(".json")
    try:
        there = json.loads(path.read_bytes())
    except FileNotFoundError:
        return path
    except (OSError, ValueError):
        there = None
    if not (isinstance(there, dict) and {"scenario", "rows"} <= there.keys()):
        raise ConfigError(
            f"--picture {picture}: the table goes into {path}, which is there and is no such table; give another name, or remove "
            "it first"
        )
    return path


#: and what is left out first where there is no room
_HEADINGS = {
    "noise": 0, "method": 0, "of": 0, "rms": 0, "bound": 0, "ratio": 3, "median": 2, "in band": 4, "NEES": 0, "left": 1,
}  # fmt: skip


def _table(rows: Sequence[Row]) -> Columns:
    table = Columns([Column(heading, number=True, spare=spare) for heading, spare in _HEADINGS.items()])
    for row in rows:
        table.add(
            f"{row.noise_dps:g}",
            row.method,
            row.parameter,
            f"{row.rms:.2e}",
            f"{row.bound:.2e}",
            f"{row.rms / row.bound:.3g}",
            f"{row.median:+.1e}",
            "" if row.inside is None else f"{100 * row.inside:.1f}%",
            "" if row.nees is None else f"{row.nees:.3f}",
            f"{100 * row.test:.2f}%" if row.parameter == "k" else "",
        )
    return table
