"""Settings and state of the zero angular rate update (zaru.py)."""

from dataclasses import dataclass, field
from math import inf, radians

import msgspec
import numpy as np
from numpy.typing import NDArray

from estimator.state import StateStruct
from estimator.tracking.evidence import Evidence, Receipt
from estimator.tracking.tilt_check import TiltKnobs, TiltState

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ZaruKnobs:
    """When a rest is evidence of the bias: assumed motion of a resting body, and limits."""

    #: rad/s, motion of a resting body that no reading shows
    quasi_static: float = radians(0.003)
    #: rad/s, the same while quiet for less than proven_after seconds: too short to tell rest from a slow breath or sway
    unproven: float = radians(0.1)
    #: rad/s, the same without an accelerometer: so much a person sways who stands for a moment (tests/bench/honesty.py); and
    #: before any proven rest of an unknown bias: half a breath at power-up shut out the truth for minutes
    #: (tests/consistency/test_warming.py; seed 16, begun late)
    unproven_at_most: float = radians(0.19)
    proven_after: int = 4
    #: rad/s, the same in the last second of a rest: a movement may begin too gently for a gyro alone
    edge: float = radians(0.015)
    #: ratio of scatter to noise variance of the means above which a body moves a little
    scatter: float = 3.0
    #: a jump of the bias is believed after this many seconds of rest in a row
    sure_rests: int = 5
    #: NIS gate of the vertical part of a rest: 4 standard deviations
    vertical_gate: float = 16.0
    #: s; a contradiction that stays the same for this long is believed
    insist_s: float = 120.0
    #: factor by which the bias may have walked faster than BiasKnobs say, in a gap between rests
    hurry: float = 5.0
    #: s, least length of a gap
    gap_s: float = 5.0
    #: rad/s; gated measurements wait and are judged together until their mean is this good; longest wait, s
    certain: float = radians(0.006)
    longest_wait_s: int = 8
    tilt: TiltKnobs = field(default_factory=TiltKnobs)


class ZaruState(StateStruct):
    """State of ZARU.

    means (k, 2, 3): mean and its variance of the latest quiet seconds. quiet: quiet seconds in a row; quiet_until: end of the
    last, s. rests: seconds of rest in a row. gap_s: how long the device moved before this rest. proven: whether the latest
    second belongs to a proven rest. ever_proven: whether any did, or the bias was known at the start. rested: whether a rest
    was proven since a restart. blind: whether samples were missing, and no rest was seen since. surprised: kinds of evidence
    already checked against the gap. in_question: variance, (rad/s)², of a bias believed only for its insistence. waiting:
    measurements to be judged with the following ones. contradiction: its begin, s, and z and R measured
    then. surprises, judged: receipts not yet fetched.
    """

    tilt: TiltState
    ever_proven: bool
    means: Floats = msgspec.field(default_factory=lambda: np.zeros((0, 2, 3)))
    quiet: int = 0
    quiet_until: float = inf
    rests: int = 0
    gap_s: float = 0.0
    proven: bool = False
    rested: bool = True
    blind: bool = False
    surprised: set[str] = msgspec.field(default_factory=lambda: {"zaru", "zaru level", "zaru vertical"})
    in_question: float = 0.0
    waiting: list[tuple[Evidence, float, float, float]] = msgspec.field(default_factory=list)
    contradiction: tuple[float, Floats, Floats] | None = None
    surprises: list[Receipt] = msgspec.field(default_factory=list)
    judged: list[Receipt] = msgspec.field(default_factory=list)
