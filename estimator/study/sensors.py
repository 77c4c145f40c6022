"""Tables 2 and 3 of Wang et al. 2024: its two sensors, calibrated many times by its four methods and by closure."""

from collections.abc import Sequence
from math import inf

import numpy as np
from msgspec import Struct
from rich.console import RenderableType

from bridge.terminal.tables import Column, Columns
from estimator.study.device import PaperColumn
from estimator.study.simulation import PARAMETERS
from estimator.study.spread import Spread, holds, spread
from estimator.study.study import Finding, Floats, Parts, Study
from estimator.study.trials import METHODS, WORDS, SensorsScenario, inputs, jobs, work


class Row(Struct, frozen=True):
    """Result for one parameter of a sensor by one method: a scale factor k (no unit) or an element of b (°/s).

    The paper's b is minus the bias.
    value: spread of the estimates over the sessions. error: spread of their differences from the truth.
    size_95: 95 % quantile of the error's magnitude. std: median of the standard deviations that the method states.
    paper: the paper's value, or None. inside: True if it lies in the middle 95 % of our estimates.
    """

    sensor: str
    method: str
    parameter: str
    truth: float
    value: Spread
    error: Spread
    size_95: float
    std: float
    paper: float | None
    inside: bool | None


class Session(Struct, frozen=True):
    """Summary of all simulated sessions of one sensor by one method.

    sessions: number of sessions. accepted: fraction with verdict ACCEPTED.
    time_s: median duration of a session, s. paper_time_s: duration in the paper, s, or None.
    """

    sensor: str
    method: str
    sessions: int
    accepted: float
    time_s: float
    paper_time_s: float | None


class Sensors(Struct, frozen=True):
    """Results of the study: a row per sensor, method and parameter, and a summary of the sessions per sensor and method.

    labels: titles of the sensors by name.
    paper_limit: by sensor, the largest error in the paper of scale factors (no unit) and bias (°/s).
    machine: by method, the median time that this computer needs to calibrate one session, ms.
    """

    labels: dict[str, str]
    paper_limit: dict[str, float]
    rows: list[Row]
    sessions: list[Session]
    machine: dict[str, float]

    def of(self, sensor: str, method: str) -> list[Row]:
        """Rows of one sensor and one method: three scale factors and three elements of b."""
        return [row for row in self.rows if (row.sensor, row.method) == (sensor, method)]

    def worst_k(self, sensor: str, method: str) -> float:
        """95 % quantile of the error of k (no unit) on the worst axis; infinite when no session gave an estimate."""
        return max((row.size_95 for row in self.of(sensor, method) if row.parameter.startswith("k")), default=inf)


def results(scenario: SensorsScenario, parts: Parts) -> Sensors:
    """Compute the spread of estimates and errors by sensor, method and parameter, and the fraction accepted.

    Sessions without an estimate count as not accepted. They are not part of any spread.
    """
    rows, sessions, machine = [], [], {}
    devices = inputs(scenario).devices
    for method in METHODS:
        took = []
        for name, device in devices.items():
            mine = [part for job, part in parts.items() if job[:2] == (name, method)]
            found, std, accepted, lasts = (
                np.concatenate([part[key] for part in mine]) for key in ("found", "std", "accepted", "lasts")
            )
            took += [part["took"] for part in mine]
            column = device.paper.get(method)
            time_s = float(np.median(lasts))
            paper_s = column.time_s if column else None
            sessions.append(Session(name, method, len(found), float(accepted.mean()), time_s, paper_s))
            known = np.isfinite(std).all(axis=1)
            truth = np.concatenate([device.k, device.b_dps])
            if known.any():
                rows += _rows(name, method, found[known], std[known], truth, column)
        machine[method] = round(1e3 * float(np.median(np.concatenate(took))), 1)
    labels = {name: device.label for name, device in devices.items()}
    return Sensors(labels, scenario.paper_limit, rows, sessions, machine)


def _rows(name: str, method: str, found: Floats, std: Floats, truth: Floats, column: PaperColumn | None) -> list[Row]:
    paper = [None] * 6 if column is None else [*column.k, *column.b_dps]
    rows = []
    for i, parameter in enumerate(PARAMETERS):
        value, error = spread(found[:, i]), spread(found[:, i] - truth[i])
        size = float(np.quantile(np.abs(found[:, i] - truth[i]), 0.95))
        theirs = paper[i]
        # The paper's turntable column is the truth of the simulation: no comparison.
        inside = None if theirs is None or method == "turntable" else holds(value.band, theirs)
        rows.append(
            Row(
                name,
                method,
                parameter,
                float(truth[i]),
                value,
                error,
                size,
                float(np.median(std[:, i])),
                theirs,
                inside,
            )
        )
    return rows


def tables(found: Sensors) -> Sequence[RenderableType]:
    """Build one table per sensor with the six parameters by method, and a table of the sessions."""
    shown: list[RenderableType] = []
    for sensor, label in found.labels.items():
        n = next(one.sessions for one in found.sessions if one.sensor == sensor)
        names = {"method": 0, "of": 0, "median": 0, "95 % of sessions": 0, "std": 1, "paper": 0, "inside": 0}
        table = Columns(
            [Column(name, number=True, spare=spare) for name, spare in names.items()],
            title=f"{label}: {n} simulated sessions by each method; b in °/s, the paper's sign",
        )
        for row in (row for row in found.rows if row.sensor == sensor):
            digits = 4 if row.parameter.startswith("k") else 3
            table.add(
                WORDS[row.method],
                row.parameter,
                f"{row.value.median:.{digits}f}",
                f"{row.value.band[0]:.{digits}f} … {row.value.band[1]:.{digits}f}",
                f"{row.std:.{digits}f}",
                "" if row.paper is None else f"{row.paper:.{digits}f}",
                {True: "yes", False: "no", None: ""}[row.inside],
            )
        shown.append(table)
    names = {"sensor": 0, "method": 0, "accepted": 0, "session s": 0, "paper s": 0, "computing ms": 0, "k within": 0}
    table = Columns(
        [Column(name, number=True, spare=spare) for name, spare in names.items()],
        title="Sessions; k within: 95 % of the errors of the worst axis",
    )
    for one in found.sessions:
        table.add(
            found.labels[one.sensor],
            WORDS[one.method],
            f"{100 * one.accepted:.0f}%",
            f"{one.time_s:.0f}",
            "" if one.paper_time_s is None else f"{one.paper_time_s:.0f}",
            f"{found.machine[one.method]:.0f}",
            f"{found.worst_k(one.sensor, one.method):.4f}" if found.of(one.sensor, one.method) else "",
        )
    return *shown, table


def findings(found: Sensors) -> Sequence[Finding]:
    """Judge tables 2 and 3 of Wang et al. 2024, its limits of the errors, and its calibration times."""
    told = [_table(found, name) for name in found.labels]
    return *told, _limits(found), _time(found)


def _table(found: Sensors, name: str) -> Finding:
    compared = [row for row in found.rows if row.sensor == name and row.inside is not None]
    inside = [row for row in compared if row.inside]
    proposed = [row for row in compared if row.method == "turn360" and row.parameter.startswith("k")]
    theirs = max((abs((row.paper or 0.0) - row.truth) for row in proposed), default=inf)
    ours = found.worst_k(name, "turn360")
    share = len(inside) / max(len(compared), 1)
    of = {
        letter: f"{sum(row.parameter[0] == letter for row in inside)} of "
        f"{sum(row.parameter[0] == letter for row in compared)}"
        for letter in "bk"
    }
    return Finding(
        name,
        f"{of['b']} of the paper's b and {of['k']} of its k lie in our 95 % range; k within {ours:.4f} (proposed)",
        "agrees" if share > 0.9 else "agrees in part" if share > 0.3 else "differs",
        f"the paper's k are off by up to {theirs:.4f}, {theirs / ours:.0f} times what such a hand and sensor explain",
    )


def _limits(found: Sensors) -> Finding:
    said, k_kept, b_kept = [], True, True
    for name, label in found.labels.items():
        limit, k = found.paper_limit[name], found.worst_k(name, "turn360")
        b = max((row.size_95 for row in found.of(name, "turn360") if row.parameter.startswith("b")), default=inf)
        k_kept, b_kept = k_kept and k < limit, b_kept and b < limit
        said.append(f"{label}: k {k:.4f}, b {b:.3f} °/s")
    return Finding(
        "limits",
        "; ".join(said) + " (95 %)",
        "agrees" if k_kept and b_kept else "agrees in part" if k_kept else "differs",
        "" if b_kept else "b differs by the drift of the model's bias between two sessions",
    )


def _time(found: Sensors) -> Finding:
    by = {(one.sensor, one.method): one for one in found.sessions}
    hand = [by[name, "turn360"].time_s for name in found.labels]
    aided = [by[name, "accel_aided"].time_s for name in found.labels]
    rows = {method: max(found.worst_k(name, method) for name in found.labels) for method in ("turn360", "accel_aided")}
    return Finding(
        "time",
        f"{max(hand):.0f} s, accelerometer-aided {max(aided):.0f} s; k within {rows['turn360']:.4f} and "
        f"{rows['accel_aided']:.4f}",
        "agrees" if max(hand) < 30 and rows["turn360"] < 2 * rows["accel_aided"] else "agrees in part",
        f"computing takes {found.machine['turn360']:.0f} ms",
    )


STUDY = Study("sensors", SensorsScenario, results, tables, findings, inputs=inputs, jobs=jobs, work=work)
