"""Gravity evidence: gravity propagated by the gyro through any motion, compared with the accelerometer.

States appended to the filter, all in the present sensor axes:

    g   gravity (3) m/s², as a resting accelerometer would read it
    v   velocity (3) m/s
        accelerometer bias (3) m/s²
        relative change of the gyro matrix (9, row by row), no unit

A span is an uninterrupted stretch of about one second. Over a span of T seconds strapdown.py integrates the rotation C
and the velocity change `push`, m/s:

    g' = C^T g,   v' = C^T (v + push - g T),   accelerometer bias and matrix stay.

Gravity has no direct measurement. But the velocity of a wearer is bounded, so its mean over a span is measured as zero.
A wrong bias tilts g, and a tilted g makes v grow without limit. So the bias becomes observable.

The error of this measurement depends on the unrest of the span. Unrest is the rms variation of the velocity within the
span, m/s. The mean velocity is used because motion to and fro within a second cancels in it. A walker's velocity does
not cancel, and stays the same for many seconds. The variance of the measurement is then enlarged (steady_motion.py).
The gyro's scale and misalignment are states, because an error of 0.4 % at 100 °/s is larger than a usual bias.
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
    """Settings of the gravity evidence, as standard deviations if not stated otherwise.

    speed, speed_per_unrest, fastest: mean speed of a wearer over a span, m/s. It is `speed` plus `speed_per_unrest`
        times the unrest (m/s), at most `fastest`.
    resting_speed: speed of a resting device, m/s.
    doubt: gate of the measured velocity: NIS with 3 degrees of freedom above which its covariance is enlarged.
    way_share: rotation error per angle turned in a span, rad per rad.
    accel_noise, accel_bias, accel_walk: accelerometer noise, m/s² per root Hz; its bias, m/s²; random walk of this
        bias, m/s² per root second.
    accel_pose: change of the accelerometer's error with attitude, m/s² per rad, and its largest value, m/s².
    strength: magnitude of gravity at the start, m/s². first: largest error of the first gravity vector, m/s².
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
    """State of the gravity evidence, in addition to the states in the filter.

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

        scale_std, cross_std (3,): relative standard deviations of the gyro matrix. For each row, that of its diagonal
            element, and that of its two other elements.
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
        """Prediction step over a span for `BiasFilter.predict`: propagates gravity and velocity, and adds their noise.

        span: integrals of about one second of readings, computed with the filter's own bias and matrix. If gravity is
            not known, it starts from the mean acceleration of the span.
        bias: the filter that has the states.
        gyro_noise: white noise of the rates, rad/s per root Hz.
        unseen_turn, unseen_push: standard deviations of angle (rad) and velocity change (m/s) from lost samples.
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
        """Zero-velocity measurement (3,), m/s, for the span that `carry` has just propagated.

        resting: True for a resting device: the velocity at the end of the span is measured as zero. False: the mean
            velocity over the span is measured as zero.
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

        resting: True for a resting device. If so, or if the test ratio is above 1, the receipt does not show walking.
        The detector then only forgets the previous innovation.
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
