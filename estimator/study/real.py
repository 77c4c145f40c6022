"""Study `real`: a real session calibrated by every applicable method, compared with the results of imucal, its source."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct
from rich.console import RenderableType

from bridge.reasons.catalogue import english
from bridge.recording import load
from bridge.terminal.tables import Column, Columns
from estimator.offline import recordings
from estimator.study.study import Parts, Scenario, Study

METHODS = ("turn360", "closure", "transitions", "accel_aided")
WORDS = {
    "readings": "readings",
    "imucal": "imucal, its session",
    "turn360": "Algorithm 1",
    "closure": "closure",
    "transitions": "transitions",
    "accel_aided": "accel-aided",
}
_AXES = ("x", "y", "z")


class Theirs(Struct, frozen=True, forbid_unknown_fields=True):
    """Result of imucal: diagonal of its matrix K_g (reading over rate, no unit), and closure errors of three turns, degrees."""

    reading_per_rate: tuple[float, float, float]
    closure_deg: tuple[float, float, float]


class RealScenario(Scenario, frozen=True, kw_only=True):
    """Scenario of study `real`.

    recording: path of the session's file. imucal: imucal's own result for that session.
    """

    recording: str = ""
    imucal: Theirs


class Row(Struct, frozen=True):
    """Result of one method on the real session.

    k, k_std (3): scale factors and their standard deviations, no unit. closure_deg (3): closure errors of the turns,
        degrees.
    A value is None where the method does not give it.
    """

    method: str
    verdict: str
    reason: str
    k: list[float] | None
    k_std: list[float] | None
    closure_deg: list[float] | None


class Real(Struct, frozen=True):
    """Results of the study: one row per method, imucal included."""

    recording: str
    rows: list[Row]


def results(of: RealScenario, _: Parts) -> Real:
    """Calibrate the whole recording by each method that applies; return one row per method, imucal's own first."""
    recording = load(of.recording)
    closed = recordings.calibrate(recording, "closure")[0]
    turns = {turn.axis: turn for turn in closed.turns}
    rows = [Row("imucal", "", "", [1 / k for k in of.imucal.reading_per_rate], None, list(of.imucal.closure_deg))]
    for method in METHODS:
        result = recordings.calibrate(recording, method)[0]
        if not np.isfinite(result.covariance).all():
            rows.append(Row(method, result.verdict.name.lower(), english(*result.reason), None, None, None))
            continue
        own = {turn.axis: turn.closure_error for turn in result.turns} if result.turns else {}
        std = np.sqrt(np.diag(result.covariance))[3:6]
        rows.append(
            Row(
                method,
                result.verdict.name.lower(),
                english(*result.reason),
                [float(k) for k in result.scale],
                [float(s) for s in std],
                [float(np.degrees(own[a])) for a in sorted(turns)] if set(own) >= set(turns) else None,
            )
        )
    return Real(Path(of.recording).name, rows)


def tables(found: Real) -> Sequence[RenderableType]:
    """Build a table with one row per method, and the reasons of the methods without an estimate."""
    table = Columns(
        [Column("method", least=11), *(Column(f"k_{a}", number=True) for a in _AXES), Column("std", number=True, spare=1),
         *(Column(f"{a} open °", number=True) for a in _AXES), Column("verdict")],
        title=f"{found.recording}: scale factors, and closure errors of the turns",
    )  # fmt: skip
    for row in found.rows:
        k = ["–"] * 3 if row.k is None else [f"{x:.4f}" for x in row.k]
        std = "" if row.k_std is None else f"{max(row.k_std):.4f}"
        closed = ["–"] * 3 if row.closure_deg is None else [f"{x:.3f}" for x in row.closure_deg]
        table.add(WORDS[row.method], *k, std, *closed, row.verdict)
    reasons = [f"{WORDS[row.method]}: {row.reason}" for row in found.rows if row.k is None]
    return table, *reasons


STUDY = Study("real", RealScenario, results, tables, lambda _: ())
