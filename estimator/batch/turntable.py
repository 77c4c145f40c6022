"""The six-rate calibration on a turntable: known rates, either way, about each axis in turn; linear least squares.

Source: IEEE Std 952, the rate test of a triad, as in the paper's comparison (Wang et al. 2024). Letters:

    s_i   true rate of plateau i: the known rate about the axis that reads most, with the reading's sign
    m_i   mean reading;   s_i = M m_i - c,  c = M b:  linear in M (9) and c (3)
    C     covariance of the equations: noise of the readings, the table's rate, and how squarely the device was fixed,
          the same for all plateaus of one fixing

The matrix is that in the fixture's axes: a device fixed askew has its own case's misalignment in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from bridge.wire.messages import Verdict
from estimator.batch.capture import Floats, Samples
from estimator.batch.carry import COLUMN, MATRIX_PARAMETERS, ROW
from estimator.batch.plateaus import Plateau, nearest_rates, plateaus, still
from estimator.batch.result import Result, VerdictKnobs, nothing, unbelievable
from estimator.gyro import AXES, reading_std


@dataclass(frozen=True, slots=True)
class TurntableKnobs:
    """How good the table is."""

    #: relative error of its rate
    rate_share: float = 1e-4
    #: rad, by which the device is fixed off the table's axis
    square: float = radians(0.1)


def by_turntable(samples: Samples, rates: tuple[float, ...], knobs: TurntableKnobs | None = None) -> Result:
    """Full matrix and bias from a recording on a turntable; rates in rad/s, each used in both directions."""
    knobs = knobs or TurntableKnobs()
    found = plateaus(samples)
    spins = [p for p in found if not still(p, rates)]
    missing = tuple(
        axis for axis in range(3) if {np.sign(p.mean[axis]) for p in spins if p.axis == axis} != {-1.0, 1.0}
    )
    if missing:
        names = ", ".join(AXES[axis] for axis in missing)
        reason = f"{len(spins)} stretches of constant rate, but not both ways about {names}: 1.5 s or more each way"
        return nothing("turntable", Verdict.REPEAT, reason, missing)
    true, mounts = _true_rates(spins, rates)
    rests = [p for p in found if still(p, rates)]
    used = [*spins, *rests]
    s = np.vstack([true, np.zeros((len(rests), 3))])
    m = np.array([p.mean for p in used])
    # The noise's weight needs a scale factor: the ratio of rates is near enough.
    k = np.array(
        [np.median(np.abs(true[:, a][true[:, a] != 0] / m[: len(spins), a][true[:, a] != 0])) for a in range(3)]
    )
    design = np.kron(np.eye(3), np.column_stack([m, -np.ones(len(m))]))
    C = _covariance(used, s, [*mounts, *[None] * len(rests)], k, knobs)
    weight = np.linalg.inv(np.linalg.cholesky(C))
    x, *_ = np.linalg.lstsq(weight @ design, weight @ s.T.ravel(), rcond=None)
    x_cov = np.linalg.inv(design.T @ weight.T @ weight @ design)
    M, c = x.reshape(3, 4)[:, :3], x.reshape(3, 4)[:, 3]
    missed = s.T.ravel() - design @ x
    misfit = float(np.sum((weight @ missed) ** 2)) / max(len(missed) - 12, 1)
    return _judge(M, c, x_cov * max(misfit, 1.0), used, missed, misfit)


def _true_rates(spins: Sequence[Plateau], rates: tuple[float, ...]) -> tuple[Floats, list[int]]:
    """(n, 3) true rate of each spin, and the number of its fixing: a new one whenever the axis changes."""
    true = np.zeros((len(spins), 3))
    for axis in range(3):
        own = [i for i, p in enumerate(spins) if p.axis == axis]
        reading = np.array([spins[i].mean[axis] for i in own])
        # Half of what the two directions differ by is bias; without it sizes can be compared.
        middle = (reading.max() + reading.min()) / 2
        true[own, axis] = np.sign(reading) * nearest_rates(np.abs(reading - middle), rates)
    mounts, mount = [], 0
    for i, p in enumerate(spins):
        mount += i > 0 and p.axis != spins[i - 1].axis
        mounts.append(mount)
    return true, mounts


def _covariance(
    used: Sequence[Plateau], s: Floats, mounts: Sequence[int | None], k: Floats, knobs: TurntableKnobs
) -> Floats:
    """(3n, 3n) of the equations, first those of the output x."""
    n = len(used)
    var = np.array([p.var for p in used]) * k**2 + (knobs.rate_share * s) ** 2
    C = np.diag(var.T.ravel())
    # A fixing off by a small rotation e turns the true rate s into s + e x s.
    for mount in {mount for mount in mounts if mount is not None}:
        cross = np.zeros((3 * n, 3))
        for i in (i for i in range(n) if mounts[i] == mount):
            x, y, z = s[i]
            cross[[i, n + i, 2 * n + i]] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        C += knobs.square**2 * cross @ cross.T
    return C


def _judge(M: Floats, c: Floats, x_cov: Floats, used: Sequence[Plateau], missed: Floats, misfit: float) -> Result:
    bias = np.asarray(np.linalg.solve(M, c))
    # bias = M⁻¹ c, so its error is M⁻¹ (error of c - error of M · bias).
    inverse = np.linalg.inv(M)
    J = np.zeros((12, 12))
    for row in range(3):
        J[:3, 4 * row : 4 * row + 3] = -np.outer(inverse[:, row], bias)
        J[:3, 4 * row + 3] = inverse[:, row]
    J[3 + np.arange(9), 4 * ROW + COLUMN] = 1.0
    covariance = J @ x_cov @ J.T
    noise_std = reading_std(np.median([p.std for p in used], axis=0))
    bad = unbelievable(np.diag(M), VerdictKnobs())
    rms = degrees(float(np.sqrt(np.mean(missed**2))))
    reason = f"{len(used)} stretches of constant rate met to {rms:.3f} °/s rms"
    verdict = Verdict.ACCEPTED
    repeat: tuple[int, ...] = ()
    if bad is not None:
        verdict, repeat, reason = Verdict.REFUSED, *bad
    elif misfit > 9.0:
        verdict = Verdict.REFUSED
        reason += f", {misfit**0.5:.0f} times worse than a table errs: are the rates right?"
    time = float(np.mean([(p.start + p.end) / 2 for p in used]))
    return Result("turntable", verdict, reason, M, bias, covariance, noise_std, (), repeat, time, MATRIX_PARAMETERS)
