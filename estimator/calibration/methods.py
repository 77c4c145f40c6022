"""Calibration methods by name: METHODS for captures by hand, BY_RATES for recordings on machines with known rates.

Each method is a function that returns a Result. A BY_RATES method takes samples, the machine's rates (rad/s), and the
prior bias wander.
"""

from collections.abc import Callable
from math import radians

import numpy as np

from bridge.wire.messages import Verdict
from estimator.calibration import accel_aided, closure, misalignment, servomotor, transitions, turn360, turntable
from estimator.calibration.bias_wander import WanderKnobs
from estimator.calibration.capture import Capture, Samples
from estimator.calibration.method_names import BY_HAND
from estimator.calibration.result import NotConverged, Result, judge, nothing

Method = Callable[[Capture], Result]
#: rad, largest closure error of a turn; tighter than for Algorithm 1: in the closure method, wobble causes no closure error
_CLOSURE = radians(3.0)


def by_turn360(capture: Capture) -> Result:
    """Calibration method `turn360`: bias (3,) rad/s and scale factors (3,) by Algorithm 1 of Wang et al. 2024, with verdict.

    Uses one rest and three turns. Verdict REFUSED, without an estimate, when the iteration does not converge.
    """
    try:
        found = turn360.estimate(capture)
    except NotConverged as error:
        return nothing("turn360", Verdict.REFUSED, (error.reason,), repeat=(0, 1, 2))
    return judge("turn360", capture, found.k, found.bias, found.covariance)


def by_closure(capture: Capture) -> Result:
    """Calibration method `closure`: bias (3,) rad/s and scale factors (3,) under which every turn ends where it began.

    Maximum likelihood over all rests and three turns. Verdict REFUSED, without an estimate, when the fit does not
    converge.
    """
    try:
        found = closure.estimate(capture)
    except NotConverged as error:
        return nothing("closure", Verdict.REFUSED, (error.reason,), repeat=(0, 1, 2))
    return judge(
        "closure",
        capture,
        found.k,
        found.bias,
        found.covariance,
        closure=_CLOSURE,
        turn_bias=found.turn_bias,
        unclosed=np.linalg.norm(found.residual, axis=1),
        bias_time=found.time,
        note=misalignment.said(found.misalignment_std, float(np.max(np.sqrt(np.diag(found.covariance)[3:]) / found.k))),
    )


METHODS: dict[str, Method] = dict(
    zip(BY_HAND, (by_closure, by_turn360, transitions.by_transitions, accel_aided.by_accel_aided), strict=True)
)
#: methods that need no full turns, with the least number of movements for a full matrix
BY_MOVEMENTS: dict[str, int] = {"transitions": transitions.FEWEST, "accel_aided": accel_aided.FEWEST_POSES - 1}
#: methods for recordings on a machine that turns at known rates (rad/s)
BY_RATES: dict[str, Callable[[Samples, tuple[float, ...], WanderKnobs], Result]] = {
    "turntable": turntable.by_turntable,
    "servomotor": servomotor.by_servomotor,
}
