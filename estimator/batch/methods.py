"""The calibration methods by name: each takes a Capture and gives a Result."""

from collections.abc import Callable

from bridge.wire.messages import Verdict
from estimator.batch import accel_aided, servomotor, transitions, turn360, turntable
from estimator.batch.capture import Capture, Samples
from estimator.batch.result import Result, judge, nothing

Method = Callable[[Capture], Result]


def by_turn360(capture: Capture) -> Result:
    """The paper's Algorithm 1."""
    try:
        found = turn360.estimate(capture)
    except turn360.NotConverged as error:
        return nothing("turn360", Verdict.REFUSED, str(error), repeat=(0, 1, 2))
    return judge("turn360", capture, found.k, found.bias, found.covariance)


METHODS: dict[str, Method] = {
    "turn360": by_turn360,
    "transitions": transitions.by_transitions,
    "accel_aided": accel_aided.by_accel_aided,
}
#: methods that need no full turns, and how many movements they need at least before a full matrix is thinkable
BY_MOVEMENTS: dict[str, int] = {"transitions": transitions.FEWEST, "accel_aided": accel_aided.FEWEST_POSES - 1}
#: methods for recordings on a machine that turns at known rates (rad/s)
BY_RATES: dict[str, Callable[[Samples, tuple[float, ...]], Result]] = {
    "turntable": turntable.by_turntable,
    "servomotor": servomotor.by_servomotor,
}
DEFAULT = "turn360"
