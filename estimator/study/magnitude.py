"""Figure 9 of Wang et al. 2024: magnitude of a known rate about x, y, z, both ways, before and after calibration by hand."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from rich.console import RenderableType

from bridge.terminal.tables import Column, Columns
from estimator.study.spread import Spread, spread
from estimator.study.study import Arrays, Finding, Job, Parts, Study
from estimator.study.verification import WORDS, Inputs, Verification, VerificationScenario, inputs, jobs, verify

_SPINS = ("x cw", "x ccw", "y cw", "y ccw", "z cw", "z ccw")
_RAMP_S = 0.75
#: one of this many samples is drawn
_DRAWN = 4


class Row(Struct, frozen=True):
    """Spread over the sessions of the mean magnitude of the rate, °/s, in one turn of a sensor.

    spin: axis and direction of the turn, such as `x cw` (clockwise) or `x ccw`.
    rates: `raw` for readings, or the correction: `turn360`, `closure`, or `paper` for the paper's K and b.
    """

    sensor: str
    spin: str
    rates: str
    mean: Spread


class Trace(Struct, frozen=True):
    """Magnitudes of the rate over time during the turns of a sensor's first session, without ramps.

    time_s: time of each value, s from the first one. begins_s: start of each turn on this scale, s.
    dps: magnitudes, °/s, by kind of rates: `raw` for readings; `turn360`, `closure`, `paper` for corrected rates.
    """

    sensor: str
    time_s: list[float]
    dps: dict[str, list[float]]
    begins_s: list[float]


class Magnitude(Struct, frozen=True):
    """Results of the study: all rows, the first session of each sensor, and the true rate, °/s.

    labels: titles of the sensors by name.
    """

    labels: dict[str, str]
    rate_dps: float
    rows: list[Row]
    traces: list[Trace]

    def error(self, sensor: str, rates: str) -> float:
        """Rms error of the magnitude over sessions and turns of a sensor, °/s.

        rates: `raw` for readings, or the correction: `turn360`, `closure` or `paper`.
        """
        off = [r.mean.rms**2 - 2 * r.mean.mean * self.rate_dps + self.rate_dps**2 for r in self.rows
               if (r.sensor, r.rates) == (sensor, rates)]  # fmt: skip
        return float(np.sqrt(np.mean(off)))


def work(of: Inputs, job: Job) -> Arrays:
    """Simulate and calibrate one session of a sensor, and return the magnitudes of the rates in its machine turns.

    The result has the array `mean` (6 turns, 4 kinds of rates): mean magnitudes, °/s. The kinds are `raw`, `turn360`,
    `closure` and `paper`.
    The first run of a sensor also returns arrays over time: time (n,), s from the first value; dps (4, n), °/s, by kind;
    and the starts of the turns, begins (6,), s on the same scale.
    """
    found = verify(of, job)
    size = {name: np.degrees(np.linalg.norm(rate, axis=1)) for name, rate in found.rates.items()}
    steady = [_steady(found, spin) for spin in found.spins]
    arrays = {"mean": np.array([[size[name][part].mean() for name in WORDS] for part in steady])}
    if job[1] == 0:
        lengths = [len(found.time_s[part][::_DRAWN]) for part in steady]
        step = float(np.median(np.diff(found.time_s))) * _DRAWN
        arrays["time"] = step * np.arange(sum(lengths))
        arrays["dps"] = np.array([np.concatenate([size[name][part][::_DRAWN] for part in steady]) for name in WORDS])
        arrays["begins"] = step * np.concatenate([[0], np.cumsum(lengths)[:-1]])
    return arrays


def _steady(found: Verification, spin: tuple[float, float]) -> slice:
    low, high = np.searchsorted(found.time_s, (spin[0] + _RAMP_S, spin[1] - _RAMP_S))
    return slice(int(low), int(high))


def results(scenario: VerificationScenario, parts: Parts) -> Magnitude:
    """Compute the spread of the mean magnitudes, °/s, over the sessions, and collect the first session of each sensor."""
    devices = inputs(scenario).devices
    rows, traces = [], []
    for sensor in devices:
        mine = {job: part for job, part in parts.items() if job[0] == sensor}
        mean = np.array([part["mean"] for part in mine.values()])
        rows += [
            Row(sensor, spin, name, spread(mean[:, i, j]))
            for i, spin in enumerate(_SPINS)
            for j, name in enumerate(WORDS)
        ]
        first = mine[sensor, 0]
        dps = {name: [round(float(x), 3) for x in first["dps"][j]] for j, name in enumerate(WORDS)}
        time_s, begins = ([round(float(x), 3) for x in first[key]] for key in ("time", "begins"))
        traces.append(Trace(sensor, time_s, dps, begins))
    return Magnitude({name: device.label for name, device in devices.items()}, scenario.rate_dps, rows, traces)


def tables(found: Magnitude) -> Sequence[RenderableType]:
    """Build a table of the mean magnitude in each turn, °/s, before and after calibration."""
    n = found.rows[0].mean.n
    table = Columns(
        [
            Column(name, number=True)
            for name in ("sensor", "turn", "readings", "Algorithm 1", "closure", "paper's K, b")
        ],
        title=f"Mean magnitude of {found.rate_dps:g} °/s, median of {n} sessions, °/s",
    )
    for sensor, label in found.labels.items():
        for spin in _SPINS:
            means = {row.rates: row.mean.median for row in found.rows if (row.sensor, row.spin) == (sensor, spin)}
            table.add(label, spin, *(f"{means[name]:.3f}" for name in WORDS))
        table.add(label, "rms error", *(f"{found.error(sensor, name):.3f}" for name in WORDS))
    return (table,)


def findings(found: Magnitude) -> Sequence[Finding]:
    """Judge figure 9 of Wang et al. 2024: the magnitude of the rate is closer to the truth after calibration."""
    said, closer = [], True
    for sensor, label in found.labels.items():
        before, after = (found.error(sensor, name) for name in ("raw", "turn360"))
        closer = closer and after < 0.1 * before
        said.append(f"{label}: {before:.2f} to {after:.3f} °/s rms")
    theirs = ", ".join(f"{found.error(sensor, 'paper'):.2f}" for sensor in found.labels)
    why = f"the paper's own K and b leave {theirs} °/s of these readings"
    return (Finding("magnitude", "; ".join(said), "agrees" if closer else "differs", why),)


STUDY = Study("magnitude", VerificationScenario, results, tables, findings, inputs=inputs, jobs=jobs, work=work)
