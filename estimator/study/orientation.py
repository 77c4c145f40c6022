"""Figures 2 and 10 of Wang et al. 2024: angle over 360° one way and back, from readings and from calibrated rates.

The angle follows the paper's equations 5 and 6: rates rotated into the initial frame, and summed about the turn's axis.
"""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from rich.console import RenderableType

from bridge.terminal.tables import Column, Columns
from estimator.geometry import rotation
from estimator.study.spread import Spread, spread
from estimator.study.study import Arrays, Finding, Job, Parts, Study
from estimator.study.verification import WORDS, Inputs, VerificationScenario, inputs, jobs, verify

AXES = ("x", "y", "z")
IDEAL = "ideal"
#: s of rest used before and after the turns about an axis
_MARGIN_S = 1.0
_DRAWN = 8


class Row(Struct, frozen=True):
    """Spread over the sessions of the largest and the final error of the angle, degrees.

    rates: `raw` for readings, or the correction: `turn360`, `closure`, or `paper` for the paper's K and b.
    """

    sensor: str
    axis: str
    rates: str
    largest: Spread
    final: Spread


class Trace(Struct, frozen=True):
    """Angle over time of a sensor's first session, in the machine turns about one axis.

    time_s: time of each value, s from the first one.
    deg: angles, degrees, by kind of rates (`raw`, `turn360`, `closure`, `paper`), and `ideal` for the true angle.
    """

    sensor: str
    axis: str
    time_s: list[float]
    deg: dict[str, list[float]]


class Orientation(Struct, frozen=True):
    """Results of the study: all rows, the first session of each sensor, and the machine's rate, °/s.

    labels: titles of the sensors by name.
    """

    labels: dict[str, str]
    rate_dps: float
    rows: list[Row]
    traces: list[Trace]

    def largest(self, sensor: str, rates: str) -> Spread:
        """Spread of the largest error of the angle, degrees, on the axis with the largest median.

        rates: `raw` for readings, or the correction: `turn360`, `closure` or `paper`.
        """
        rows = [row for row in self.rows if (row.sensor, row.rates) == (sensor, rates)]
        return max((row.largest for row in rows), key=lambda of: of.median)


def angle_deg(rate: NDArray[np.float64], dt: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Integrate rates (n, 3), rad/s, to angles (n,), degrees, about an axis (0 to 2) of the initial frame.

    dt (n,): time for which each rate is held, s. Method: equations 5 and 6 of Wang et al. 2024.
    """
    attitude = rotation.attitudes(rate, dt)[1:]
    initial = np.einsum("tij,tj->ti", attitude, rate)
    return np.asarray(np.degrees(np.cumsum(initial[:, axis] * dt)))


def work(of: Inputs, job: Job) -> Arrays:
    """Simulate and calibrate one session of a sensor, and return the errors of the angle in its machine turns.

    The result has the array `errors` (3 axes, 4 kinds of rates, 2), degrees: the largest and the final error. The kinds
    are `raw`, `turn360`, `closure` and `paper`.
    The first run of a sensor also returns time_x (n,), s from the first value, and the angles deg_x (5, n), degrees:
    those of the four kinds, then the true one. The same follows for y and z.
    """
    found = verify(of, job)
    dt = np.full(len(found.time_s), float(np.median(np.diff(found.time_s))))
    errors, arrays = np.empty((3, len(WORDS), 2)), {}
    for axis, name in enumerate(AXES):
        begin, end = found.spins[2 * axis][0] - _MARGIN_S, found.spins[2 * axis + 1][1] + _MARGIN_S
        part = slice(*np.searchsorted(found.time_s, (begin, end)))
        ideal = angle_deg(found.truth[part], dt[part], axis)
        deg = [angle_deg(found.rates[word][part], dt[part], axis) for word in WORDS]
        for i, angle in enumerate(deg):
            errors[axis, i] = np.abs(angle - ideal).max(), abs(angle[-1] - ideal[-1])
        if job[1] == 0:
            arrays[f"time_{name}"] = (found.time_s[part] - found.time_s[part][0])[::_DRAWN]
            arrays[f"deg_{name}"] = np.array([*deg, ideal])[:, ::_DRAWN]
    return {"errors": errors, **arrays}


def results(scenario: VerificationScenario, parts: Parts) -> Orientation:
    """Compute the spread of the angle's errors (degrees) over the sessions, and collect the first session of each sensor."""
    devices = inputs(scenario).devices
    rows, traces = [], []
    for sensor in devices:
        mine = {job: part for job, part in parts.items() if job[0] == sensor}
        errors = np.array([part["errors"] for part in mine.values()])
        for i, axis in enumerate(AXES):
            rows += [
                Row(sensor, axis, word, spread(errors[:, i, j, 0]), spread(errors[:, i, j, 1]))
                for j, word in enumerate(WORDS)
            ]
            first = mine[sensor, 0]
            deg = {
                word: [round(float(x), 3) for x in first[f"deg_{axis}"][j]] for j, word in enumerate((*WORDS, IDEAL))
            }
            traces.append(Trace(sensor, axis, [round(float(t), 3) for t in first[f"time_{axis}"]], deg))
    return Orientation({name: device.label for name, device in devices.items()}, scenario.rate_dps, rows, traces)


def tables(found: Orientation) -> Sequence[RenderableType]:
    """Build a table of the largest errors of the angle by axis, degrees, before and after calibration."""
    n = found.rows[0].largest.n
    table = Columns(
        [
            Column(name, number=True)
            for name in ("sensor", "axis", "readings", "Algorithm 1", "closure", "paper's K, b")
        ],
        title=f"Largest error of the angle over ±360°, degrees, median of {n} sessions",
    )
    for sensor, label in found.labels.items():
        for axis in AXES:
            largest = {row.rates: row.largest.median for row in found.rows if (row.sensor, row.axis) == (sensor, axis)}
            table.add(label, axis, *(f"{largest[name]:.2f}" for name in WORDS))
    return (table,)


def findings(found: Orientation) -> Sequence[Finding]:
    """Judge figures 2 and 10 of Wang et al. 2024: errors of the angle before and after calibration."""
    before, after, good = [], [], True
    for sensor, label in found.labels.items():
        raw, ours = (found.largest(sensor, name).median for name in ("raw", "turn360"))
        good = good and ours < 0.05 * raw
        before.append(f"{label}: {raw:.0f}°")
        after.append(f"{label}: {ours:.1f}°")
    theirs = ", ".join(f"{found.largest(sensor, 'paper').median:.1f}°" for sensor in found.labels)
    worst = " (largest error, worst axis, of ±360°)"
    return (
        Finding("before", "; ".join(before) + worst, "agrees" if good else "agrees in part"),
        Finding(
            "after",
            "; ".join(after) + worst,
            "agrees" if good else "differs",
            f"the paper's own K and b leave {theirs} of these readings",
        ),
    )


STUDY = Study("orientation", VerificationScenario, results, tables, findings, inputs=inputs, jobs=jobs, work=work)
