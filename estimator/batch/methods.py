"""The calibration methods by name: each takes a Capture and gives a Result."""

from collections.abc import Callable

from bridge.wire.messages import Verdict
from estimator.batch import transitions, turn360
from estimator.batch.capture import Capture
from estimator.batch.result import Result, judge, nothing

Method = Callable[[Capture], Result]


def by_turn360(capture: Capture) -> Result:
    """The paper's Algorithm 1."""
    try:
        found = turn360.estimate(capture)
    except turn360.NotConverged as error:
        return nothing("turn360", Verdict.REFUSED, str(error), repeat=(0, 1, 2))
    return judge("turn360", capture, found.k, found.bias, found.covariance)


METHODS: dict[str, Method] = {"turn360": by_turn360, "transitions": transitions.by_transitions}
#: methods that need no full turns, and how many movements they need at least before a full matrix is thinkable
BY_MOVEMENTS: dict[str, int] = {"transitions": transitions.FEWEST}
DEFAULT = "turn360"
