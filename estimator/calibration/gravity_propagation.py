"""Gravity propagated through the movements of a session: residuals, derivatives and covariance under a calibration.

Source: the principle is Fong, Ong, Nee, Meas. Sci. Technol. 19 (2008) 085202, and Tedaldi, Pretto, Menegatti, ICRA
2014. This module estimates the accelerometer's errors, the bias and the matrix together, from all rests. Letters:

    theta   (21,): bias (3) rad/s | diagonal of M (3) | off-diagonal of M (6), rad |
            accelerometer errors (9), accelerometer_errors.PARAMETERS
    M       gyro matrix (3, 3), no unit: rate = M (reading - bias)
    g_i     gravity (3,) m/s² at rest i, as the accelerometer measures it under theta; residual |g_i| - G, m/s²
    u_i     direction of g_i, a unit vector in sensor axes
    R_j     rotation of movement j: integral of M (reading - bias)
    e_j     rotation vector, rad, across u_before, from u_before to R_j u_after: two residuals per movement
    r, J, C residuals, their derivatives by theta, and their covariance

C contains the noise of gyro and accelerometer, and further errors that averaging does not reduce (TransitionKnobs).
Neighbouring movements share the accelerometer error of the rest between them, so C is not diagonal. A full turn must
also end in its start heading: one more residual, rad.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import radians

import numpy as np

from estimator.calibration import accelerometer_errors, result, variance_components
from estimator.calibration.accelerometer_errors import AccelKnobs, G
from estimator.calibration.capture import Floats, Movement, Rest, Samples
from estimator.calibration.movements import biases
from estimator.calibration.turn_path import Path, integrate
from estimator.geometry import rotation
from estimator.geometry.gyro_model import AXES, reading_std

_OFF_DIAGONAL = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
ACROSS = tuple(f"m_{AXES[i]}{AXES[j]}" for i, j in _OFF_DIAGONAL)
MATRIX_PARAMETERS = (*result.PARAMETERS, *ACROSS)
PARAMETERS = (*MATRIX_PARAMETERS, *accelerometer_errors.PARAMETERS)
ROW, COLUMN = np.array([*((i, i) for i in range(3)), *_OFF_DIAGONAL]).T


@dataclass(frozen=True, slots=True)
class TransitionKnobs:
    """Settings of the method `transitions`: standard deviations of assumed errors and of priors, and two limits.

    accel_floor: error of a rest's mean acceleration that averaging does not reduce, m/s².
    path_floor, path_share, coning_share: three independent errors of a movement's rotation. They are constant (rad),
        per rad turned, and per rad of coning (change of the rotation axis between samples).
    bias_floor: difference between the bias in a movement and in the rests beside it, rad/s.
    heading_std: heading error at the end of a full turn by hand, rad.
    scale, misalignment: priors of the matrix's diagonal about 1 (no unit) and of its off-diagonal elements about 0
        (rad).
    accel: prior of the accelerometer's errors.
    short: total angle, rad, below which a movement is used in the first fit.
    element_std: off-diagonal elements are used only if each has a standard deviation below this, rad.
    """

    #: m/s², error of a rest's mean acceleration that averaging does not remove: a swaying hand, accelerometer
    #: non-linearity
    accel_floor: float = 0.03
    #: constant error of a path
    path_floor: float = radians(0.05)
    #: error of a path per rad turned: gyro non-linearity and g-sensitivity
    path_share: float = 5e-4
    #: error of a path per rad of coning: motion between the samples of a sensor that is tumbled fast
    coning_share: float = 3.0
    #: rad/s, difference of a movement's bias from that of the rests around it
    bias_floor: float = radians(0.003)
    #: heading error at the end of a full turn by hand
    heading_std: float = radians(0.5)
    #: prior of the scale factors around 1: weak, it only keeps parameters finite that the data do not show
    scale: float = 0.5
    #: prior of the off-diagonal elements of M, mean zero
    misalignment: float = 0.02
    #: a movement shorter than this is integrated well enough with the datasheet's scale for a first fit
    short: float = radians(120.0)
    #: off-diagonal elements are used when the standard deviation of each is below this
    element_std: float = 0.01
    accel: AccelKnobs = field(default_factory=AccelKnobs)


@dataclass(frozen=True, slots=True, eq=False)
class Transitions:
    """Data of gravity propagation: the n rests of a session, without repetition, and the m movements between them.

    rests (n): in the order of time.
    links (m pairs): indices in `rests` of the rests before and after each movement.
    samples (m): readings of each movement.
    turns (m): True where the movement was a full turn.
    """

    rests: tuple[Rest, ...]
    links: tuple[tuple[int, int], ...]
    samples: tuple[Samples, ...]
    turns: tuple[bool, ...]

    def only(self, chosen: Sequence[int]) -> "Transitions":
        """Select the movements with the indices `chosen`, and the rests before and after them; rests are numbered anew."""
        kept = sorted({rest for j in chosen for rest in self.links[j]})
        number = {rest: i for i, rest in enumerate(kept)}
        return Transitions(
            tuple(self.rests[rest] for rest in kept),
            tuple((number[a], number[b]) for a, b in (self.links[j] for j in chosen)),
            tuple(self.samples[j] for j in chosen),
            tuple(self.turns[j] for j in chosen),
        )


def matrix_of(elements: Floats) -> Floats:
    """Build the gyro matrix M (3, 3) from its elements (9,): the diagonal, then the off-diagonal by rows."""
    M = np.empty((3, 3))
    M[ROW, COLUMN] = elements
    return M


def collect(movements: Sequence[Movement]) -> Transitions:
    """Combine movements, in the order of time, into Transitions.

    The rest after one movement and the rest before the next become one rest if they overlap in time.
    """
    rests: list[Rest] = []
    links = []
    for movement in movements:
        before, after = movement.before, movement.after
        if rests and rests[-1].start <= before.end and before.start <= rests[-1].end:
            rests[-1] = before  # the same rest, now complete
        else:
            rests.append(before)
        rests.append(after)
        links.append((len(rests) - 2, len(rests) - 1))
    turns = tuple(movement.full_turn for movement in movements)
    return Transitions(tuple(rests), tuple(links), tuple(m.samples for m in movements), turns)


class Problem:
    """Least-squares problem of gravity propagation: residuals as functions of theta (21,), derivatives, and covariance.

    theta: gyro bias (3) rad/s, gyro matrix (9) without unit, accelerometer bias (3) m/s², scale (3) and shear (3)
        relative.
    data: rests and movements.
    knobs: assumed error sizes and priors.
    """

    def __init__(self, data: Transitions, knobs: TransitionKnobs) -> None:
        self.data, self.knobs = data, knobs
        self._noise_std = np.median([reading_std(rest.std) for rest in data.rests], axis=0)
        self.biases = biases(data.rests, data.links, knobs.bias_floor)
        #: variance of unit weight: scales the assumed covariance of gravity and heading residuals
        self.unit = 1.0
        #: number of residuals from gravity and heading
        self.rows = 2 * len(data.links) + len(data.rests) + sum(data.turns)
        self.prior_mean = np.concatenate([self.biases.mean, np.ones(3), np.zeros(6 + accelerometer_errors.N)])
        off = np.full(6, knobs.misalignment)
        self._prior_std = np.concatenate([np.full(3, np.inf), np.full(3, knobs.scale), off, knobs.accel.std()])

    def solve(self, theta: Floats) -> Floats:
        """Solve for theta (21,), gyro bias (rad/s), matrix and accelerometer errors, by Levenberg-Marquardt.

        theta (21,): start value, in the order and units of the class. The weights are recomputed once, at the first
            solution.
        """
        for _ in range(2):
            r, J, factor = self.whitened(theta)
            damping = 1e-6
            for _ in range(30):
                A, cost = J.T @ J, float(r @ r)
                step = -np.linalg.solve(A + damping * np.diag(np.diag(A)), J.T @ r)
                tried = theta + step
                r_tried, J_tried, _ = self.whitened(tried, factor)
                if float(r_tried @ r_tried) > cost + 1e-6:
                    damping = max(10 * damping, 1e-3)
                    continue
                theta, r, J, damping = tried, r_tried, J_tried, damping / 10
                if float(step @ A @ step) < 1e-6:
                    break
        return theta

    def whitened(self, theta: Floats, factor: Floats | None = None) -> tuple[Floats, Floats, Floats]:
        """Whitened residuals (n,) and their derivatives (n, 21) at theta, with the Cholesky factor that whitens them.

        theta (21,): parameters, in the order and units of the class.
        Residuals are in standard deviations. They come from gravity and heading, then from the readings at rest and the
        priors.
        factor: Cholesky factor of the covariance of the gravity and heading residuals; by default that at theta.
        """
        r, J, noise, parts = self._gravity(theta)
        lower = np.asarray(np.linalg.cholesky(self.unit * (noise + parts.sum(axis=0)))) if factor is None else factor
        both = np.linalg.solve(lower, np.column_stack([r, J]))
        r, J = self._known(theta)
        return np.concatenate([both[:, 0], r]), np.vstack([both[:, 1:], J]), lower

    def factors(self, theta: Floats) -> Floats:
        """Estimate three error variances, (3,), each divided by its assumed value; no unit.

        Order: error of a rest's mean acceleration, error of a movement's rotation, heading error after a full turn.
        theta (21,): parameters, in the order and units of the class.
        Method: restricted likelihood, see variance_components.
        """
        r, J, noise, parts = self._gravity(theta)
        known_r, known_J = self._known(theta)
        return variance_components.factors(
            variance_components.Linear(r, J, noise, parts, known_J.T @ known_J, known_J.T @ known_r)
        )

    def spread(self, theta: Floats, factors: Floats) -> Floats:
        """Covariance (21, 21) of theta, in squares of the units of theta, for given error sizes.

        theta (21,): parameters, in the order and units of the class.
        factors (3,): error variances relative to the assumed ones, result of `factors`.
        """
        _, J, noise, parts = self._gravity(theta)
        C = noise + np.tensordot(factors, parts, axes=1)
        weighted = np.linalg.solve(self.unit * (noise + parts.sum(axis=0)), J)
        known = self._known(theta)[1]
        information = known.T @ known
        inverse = np.linalg.inv(J.T @ weighted + information)
        covariance = inverse @ (weighted.T @ C @ weighted + information) @ inverse
        covariance[:3, :3] += np.diag(self.biases.mean_moved)
        return np.asarray(covariance)

    def misses(self, theta: Floats) -> tuple[Floats, Floats]:
        """Angle (m,), rad, between propagated and measured gravity of each movement, and the same in standard deviations (m,).

        theta (21,): parameters, in the order and units of the class.
        """
        r, _, noise, parts = self._gravity(theta)
        C = noise + parts.sum(axis=0)
        m = len(self.data.links)
        e = r[: 2 * m].reshape(m, 2)
        blocks = np.array([C[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] for j in range(m)])
        ratio = np.sqrt(np.einsum("ji,jik,jk->j", e, np.linalg.inv(blocks), e))
        return np.linalg.norm(e, axis=1), ratio

    def accel_var(self, factors: Floats) -> Floats:
        """Variances (n, 3), m²/s⁴, of the mean accelerations at the n rests.

        factors (3,): relative error variances, result of `factors`.
        """
        noise = np.array([_noise_var(rest) for rest in self.data.rests])
        return np.asarray(noise + factors[0] * self.knobs.accel_floor**2)

    def path_cov(self, path: Path, factors: Floats) -> Floats:
        """Covariance (3, 3), rad², of the end attitude of a movement's path, as a small rotation in the frame of its start.

        factors (3,): relative error variances, result of `factors`.
        """
        return np.asarray(path.noise + factors[1] * self._path_var(path) * np.eye(3))

    def _known(self, theta: Floats) -> tuple[Floats, Floats]:
        """Rows of variance 1: the bias at each rest, then the priors."""
        std = np.sqrt(self.biases.noise)
        rest_r = (np.array([rest.bias for rest in self.data.rests]) - self.biases.at_rest - theta[:3]) / std
        rest_J = np.zeros((rest_r.size, len(theta)))
        rest_J[:, :3] = np.vstack([np.diag(-1 / row) for row in std])
        priors = np.flatnonzero(np.isfinite(self._prior_std))
        prior_r = (theta - self.prior_mean)[priors] / self._prior_std[priors]
        prior_J = (np.eye(len(theta)) / self._prior_std[:, None])[priors]
        return np.concatenate([rest_r.ravel(), prior_r]), np.vstack([rest_J, prior_J])

    def _gravity(self, theta: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Residuals, slopes, covariance of the measured noise, and covariances (3, …) of the assumed errors.

        Rows: two for each movement, one for each rest, one for each full turn.
        """
        data, knobs, M = self.data, self.knobs, matrix_of(theta[3:12])
        m, n, turned = len(data.links), len(data.rests), np.flatnonzero(data.turns)
        r, J = np.zeros(2 * m + n + len(turned)), np.zeros((2 * m + n + len(turned), len(theta)))
        by_accel, by_path = np.zeros((len(r), 3 * n)), np.zeros((len(r), 3 * m))
        noise, floors = np.zeros((3 * m, 3 * m)), np.zeros(3 * m)
        g, slope, shape = zip(
            *(accelerometer_errors.measured(_accel(rest), theta[12:]) for rest in data.rests), strict=True
        )
        size = [float(np.linalg.norm(g_i)) for g_i in g]
        u = [g_i / s for g_i, s in zip(g, size, strict=True)]
        across = [(np.eye(3) - np.outer(u_i, u_i)) / s for u_i, s in zip(u, size, strict=True)]
        for i in range(n):
            row, own = 2 * m + i, slice(3 * i, 3 * i + 3)
            r[row], J[row, 12:], by_accel[row, own] = size[i] - G, u[i] @ slope[i], u[i] @ shape[i]
        for j, (a, b) in enumerate(data.links):
            path = integrate(data.samples[j], M, theta[:3] + self.biases.local[j], self._noise_std)
            rows, own = slice(2 * j, 2 * j + 2), slice(3 * j, 3 * j + 3)
            arrived = path.end @ u[b]
            plane = _tangents(u[a])
            r[rows] = plane @ _to(u[a], arrived)
            # A small rotation phi moves `arrived` by phi x arrived, so the residual rotation across u grows by phi.
            by_a, by_b = -rotation.cross_matrix(arrived) @ across[a], rotation.cross_matrix(u[a]) @ path.end @ across[b]
            J[rows, 3:12] = plane @ path.by_matrix[:, ROW, COLUMN]
            J[rows, :3] = plane @ path.by_bias
            J[rows, 12:] = plane @ (by_a @ slope[a] + by_b @ slope[b])
            by_accel[rows, 3 * a : 3 * a + 3] = plane @ by_a @ shape[a]
            by_accel[rows, 3 * b : 3 * b + 3] = plane @ by_b @ shape[b]
            by_path[rows, own] = plane
            noise[own, own], floors[own] = path.noise, self._path_var(path)
            if data.turns[j]:
                row = 2 * m + n + int(np.searchsorted(turned, j))
                r[row] = u[a] @ rotation.log(path.end)
                J[row, 3:12], J[row, :3] = u[a] @ path.by_matrix[:, ROW, COLUMN], u[a] @ path.by_bias
                by_path[row, own] = u[a]
        accel_noise = np.concatenate([_noise_var(rest) for rest in data.rests])
        C = (by_accel * accel_noise) @ by_accel.T + by_path @ noise @ by_path.T
        heading = np.zeros(len(r))
        heading[2 * m + n :] = knobs.heading_std**2
        accel = knobs.accel_floor**2 * by_accel @ by_accel.T
        return r, J, C, np.array([accel, (by_path * floors) @ by_path.T, np.diag(heading)])

    def _path_var(self, path: Path) -> float:
        knobs = self.knobs
        floors = (
            knobs.path_floor,
            knobs.path_share * path.way,
            knobs.coning_share * path.coning,
            knobs.bias_floor * path.seconds,
        )
        return float(np.sum(np.square(floors)))


def _accel(rest: Rest) -> Floats:
    if rest.accel is None:
        raise ValueError(
            "one of the rests has no accelerometer readings; the method 'transitions' needs them at every rest"
        )
    return rest.accel


def _noise_var(rest: Rest) -> Floats:
    """Variance (3,) of a rest's mean acceleration from white noise."""
    return np.zeros(3) if rest.accel_std is None else rest.accel_std**2 / rest.n


def _tangents(u: Floats) -> Floats:
    """Two unit vectors (2, 3) across u."""
    first = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(u, first)])


def _to(u: Floats, v: Floats) -> Floats:
    """Shortest rotation vector (3,) from unit vector u to v."""
    axis = np.cross(u, v)
    sine = float(np.linalg.norm(axis))
    return axis * (np.arctan2(sine, u @ v) / sine) if sine > 1e-12 else axis
