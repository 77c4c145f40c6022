"""Gravity evidence: gravity propagated by the gyro through any motion, compared with the accelerometer.

States appended to the filter, all in the present sensor axes:

    g   gravity (3) m/s², as a resting accelerometer would read it
    v   velocity (3) m/s
        accelerometer bias (3) m/s²
        relative change of the gyro matrix (9, row by row), no unit

Over a span of T seconds, with rotation C and velocity change `push` from strapdown.py:

    g' = C^T g,   v' = C^T (v + push - g T),   accelerometer bias and matrix stay.

Gravity has no direct measurement. But the velocity of a wearer is bounded, so its mean over a span is measured as zero.
A wrong bias tilts g, and a tilted g makes v grow without limit. So the bias becomes observable.

The error of this measurement depends on the unrest of the span. Unrest is how far the velocity varies within the span,
m/s, not the acceleration. The mean velocity is used because motion to and fro within a second cancels in it. A walker's
velocity does not cancel, and stays the same for many seconds, which then count as one (steady_motion.py).
The gyro's scale and misalignment are states, since 0.4 % of 100 °/s is more than any bias.
Source: bounded-velocity aiding as in inertial navigation, P. D. Groves, "Principles of GNSS, Inertial, and Multisensor
Integrated Navigation Systems", 2nd ed. (2013), ch. 15.
"""

from dataclasses import dataclass, replace
from math import exp

import msgspec
import numpy as np

from estimator.geometry.strapdown import Span
from estimator.kernels.gravity import carried
from estimator.kernels.strapdown import DRIFT, END, PUSH
from estimator.state import Floats, StateStruct
from estimator.tracking.bias_filter import BiasFilter, Step
from estimator.tracking.bias_state import OWN, BiasState
from estimator.tracking.evidence import Evidence, Receipt
from estimator.tracking.steady_motion import SteadyMotion

G = 9.80665
GRAVITY, VELOCITY, ACCEL_BIAS, MATRIX = (slice(OWN + i, OWN + j) for i, j in ((0, 3), (3, 6), (6, 9), (9, 18)))
SIZE = OWN + 18
_ONE, _NONE = np.eye(3), np.zeros(3)
_VELOCITY_SEEN = np.eye(SIZE)[VELOCITY]


@dataclass(frozen=True, slots=True)
class GravityKnobs:
    """Noise settings of the gravity evidence: accelerations in m/s², velocities in m/s, angles in rad.

    accel_noise: m/s² per root Hz. accel_walk: m/s² per root second. accel_pose: m/s² per rad. way_share: rad per rad.
    speed_per_unrest: m/s per m/s. doubt: NIS with 3 degrees of freedom.
    """

    #: m/s, standard deviation of a wearer's mean speed over a span: without unrest, added for each m/s of unrest, and at most.
    #: A limb shaken harder gets no farther; a walker reaches the limit
    speed: float = 0.07
    speed_per_unrest: float = 2.0
    fastest: float = 0.7
    #: m/s, for a resting device
    resting_speed: float = 0.01
    #: NIS (3 degrees of freedom) above which a measured velocity gets less weight
    doubt: float = 12.0
    #: rad per rad turned within a span, gyro errors: non-linearity, sensitivity to acceleration
    way_share: float = 1.4e-3
    #: accelerometer noise, m/s² per root Hz; its bias, m/s²; random walk of the bias, m/s² per root s
    accel_noise: float = 0.03
    accel_bias: float = 0.05
    accel_walk: float = 1e-3
    #: m/s² per rad, and at most: change of the accelerometer's error by turning it, since scale, misalignment and curvature act
    #: differently in each pose
    accel_pose: float = 0.05
    #: m/s², uncertainty of gravity's magnitude at the begin
    strength: float = 0.005
    #: m/s², largest error of gravity's first direction
    first: float = 4.0


class GravityState(StateStruct):
    """State of the gravity evidence, beside the states in the filter.

    known: True if gravity and velocity in the filter's state are current.
    lasting: detector of steady motion, as in walking.
    """

    known: bool = False
    lasting: SteadyMotion = msgspec.field(default_factory=SteadyMotion)


class Gravity:
    """Gravity evidence for one bias filter: propagates gravity and velocity over spans, and measures velocity as zero."""

    def __init__(self, knobs: GravityKnobs, state: GravityState | None = None) -> None:
        self.knobs, self.state = knobs, state or GravityState()
        stays = knobs.resting_speed**2 * _ONE
        self._resting = Evidence("gravity", _NONE, _VELOCITY_SEEN, stays, knobs.doubt, soft=True)

    def extend(self, state: BiasState, scale_std: Floats, cross_std: Floats) -> BiasState:
        """Append the 18 gravity states to a bias state, which gives SIZE (24) states; gravity itself is not known yet.

        scale_std, cross_std (3,): relative standard deviations of the gyro matrix, on and off its diagonal.
        """
        x, P = np.zeros(SIZE), np.zeros((SIZE, SIZE))
        x[:OWN], P[:OWN, :OWN] = state.x[:OWN], state.P[:OWN, :OWN]
        P[ACCEL_BIAS, ACCEL_BIAS] = self.knobs.accel_bias**2 * np.eye(3)
        std = np.repeat(cross_std, 3)
        std[::4] = scale_std
        P[MATRIX, MATRIX] = np.diag(std**2)
        self.lose()
        return replace(state, x=x, P=P)

    def lose(self) -> None:
        """Mark gravity and velocity as unknown, because the motion was not measured."""
        self.state.known, self.state.lasting.before = False, None

    def carry(
        self, span: Span, bias: BiasFilter, gyro_noise: float, unseen_turn: float = 0.0, unseen_push: float = 0.0
    ) -> Step:
        """Prediction step over a span for `BiasFilter.predict`: gravity and velocity move, and gain noise.

        The span must have been integrated with the filter's own bias and matrix. If gravity is not known, it starts
        from this span's mean acceleration.
        gyro_noise: white noise of the rates, rad/s per root Hz.
        unseen_turn, unseen_push: uncertainty from lost samples, rad and m/s, see `Second`.
        """
        if not self.state.known:
            self._begin(span, bias)
        knobs, T = self.knobs, span.seconds
        kept = self._accel_kept(span)
        noise = (
            gyro_noise**2 * T + (knobs.way_share * span.way) ** 2 + unseen_turn**2,
            knobs.accel_noise**2 * T + unseen_push**2,
            knobs.accel_walk**2 * T + (1 - kept**2) * self._accel_var,
        )
        return Step(*carried(bias.x, bias.cov, span.rows, kept, G, noise))

    def evidence(self, span: Span, *, resting: bool) -> Evidence:
        """Zero-velocity measurement (3,), m/s, for the span just propagated.

        resting: True for a resting device; the measured velocity is then that at the end of the span, else its mean.
        """
        if resting:
            return self._resting
        # In axes of the end: mean = v - C^T (push - shift / T) + g T / 2. The effect of a wrong bias within the span is small.
        H = _VELOCITY_SEEN.copy()
        H[0, GRAVITY.start] = H[1, GRAVITY.start + 1] = H[2, GRAVITY.start + 2] = span.seconds / 2
        R = self.state.lasting.factor * self._speed(span) ** 2 * _ONE
        return Evidence("gravity", span.rows[DRIFT], H, R, self.knobs.doubt, soft=True)

    def heard(self, receipt: Receipt, span: Span, *, resting: bool) -> None:
        """Pass the receipt of the zero-velocity measurement of a span to the steady-motion detector.

        The detector restarts if the device rests or the test ratio is above 1, as with mirrored axes. Such a receipt
        does not show walking.
        """
        if resting or receipt.test_ratio > 1:
            self.state.lasting.before = None
        else:
            self.state.lasting.heard(receipt.innovation, self._speed(span) ** 2, span.rows[END], span.seconds)

    def _speed(self, span: Span) -> float:
        return min(self.knobs.fastest, self.knobs.speed + self.knobs.speed_per_unrest * span.unrest)

    def _accel_kept(self, span: Span) -> float:
        """Share of the accelerometer's error kept in a turn: the error changes with the pose, within its limits."""
        return exp(-((self.knobs.accel_pose * min(span.way, 1.0)) ** 2) / (2 * self._accel_var))

    @property
    def _accel_var(self) -> float:
        return self.knobs.accel_bias**2 + self.knobs.accel_pose**2

    def _begin(self, span: Span, bias: BiasFilter) -> None:
        """Begin gravity along the mean accelerometer reading, independent of earlier states."""
        speed = self._speed(span)
        x, P = bias.x.copy(), bias.cov.copy()
        mean = span.rows[PUSH] / span.seconds
        up = mean / max(float(np.linalg.norm(mean)), 1e-9)
        x[GRAVITY], x[VELOCITY] = G * up, 0.0
        for part in (GRAVITY, VELOCITY):
            P[part, :] = P[:, part] = 0.0
        tilt = min(self.knobs.first, 0.1 + np.sqrt(2) * speed / span.seconds)
        along = np.outer(up, up)
        P[GRAVITY, GRAVITY] = tilt**2 * (np.eye(3) - along) + self.knobs.strength**2 * along
        P[VELOCITY, VELOCITY] = speed**2 * np.eye(3)
        bias.extend(replace(bias.state, x=x, P=P))
        self.state.known = True
