"""The calibration methods by name: each takes a Capture and gives a Result."""

from collections.abc import Callable
from math import radians

import numpy as np

from bridge.wire.messages import Verdict
from estimator.batch import closure, turn360
from estimator.batch.capture import Capture
from estimator.batch.result import Result, VerdictKnobs, judge, nothing

Method = Callable[[Capture], Result]
#: wobble leaves nothing open here, as it does in Algorithm 1
CLOSURE_VERDICT = VerdictKnobs(closure=radians(3.0))


def by_turn360(capture: Capture) -> Result:
    """The paper's Algorithm 1."""
    try:
        found = turn360.estimate(capture)
    except turn360.NotConverged as error:
        return nothing("turn360", Verdict.REFUSED, str(error), repeat=(0, 1, 2))
    return judge("turn360", capture, found.k, found.bias, found.covariance)


def by_closure(capture: Capture) -> Result:
    """Maximum likelihood over bias and scale: every turn ends where it began."""
    try:
        found = closure.estimate(capture)
    except closure.NotConverged as error:
        return nothing("closure", Verdict.REFUSED, str(error), repeat=(0, 1, 2))
    return judge(
        "closure",
        capture,
        found.k,
        found.bias,
        found.covariance,
        CLOSURE_VERDICT,
        turn_bias=found.turn_bias,
        unclosed=np.linalg.norm(found.residual, axis=1),
        misfit=found.misfit,
        bias_time=found.time,
    )


METHODS: dict[str, Method] = {"closure": by_closure, "turn360": by_turn360}
DEFAULT = "closure"
