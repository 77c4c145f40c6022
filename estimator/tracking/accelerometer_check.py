"""Whether the accelerometer is to be believed: not dead, frozen or wrongly scaled.

One that is mirrored or swapped looks well by itself; but then gravity carried by the gyro contradicts it, again and again.
"""

from dataclasses import dataclass

from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt
from estimator.tracking.seconds import Second

#: m/s², readings that are all the same deviate less from their mean, which is rounded
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class AccelerometerKnobs:
    """When it is not believed."""

    #: m/s², strength of the mean reading of a second; a wearer's movement stays within
    weakest: float = 5.0
    strongest: float = 20.0
    #: so many seconds that contradict gravity, more than those that agree, and it is not believed again in this boot
    patience: int = 30
    #: so many in a row, and something is wrong, with it or with the bias
    in_a_row: int = 5
    #: relative; a scale less certain than this takes gravity farther in a turn than a wrong bias does
    scale_std: float = 0.05


class AccelerometerState(StateStruct):
    """disbelieved: given up for the rest of this boot. alive: whether its readings have ever changed."""

    disbelieved: bool = False
    balance: int = 0
    row: int = 0
    alive: bool = False


class AccelerometerCheck:
    """Seconds, and receipts of gravity, in; whether to go on with it out."""

    def __init__(self, knobs: AccelerometerKnobs | None = None) -> None:
        self.knobs = knobs or AccelerometerKnobs()
        self.state = AccelerometerState()

    def fit(self, second: Second) -> bool:
        """Whether the readings of the next second can be gravity and a wearer's movement."""
        fit = self._fit(second)
        if not fit:
            self.state.row = 0  # one that is silent, or frozen, is against nothing any more
        return fit

    def _fit(self, second: Second) -> bool:
        if self.state.disbelieved or second.accel is None or second.accel_std is None:
            return False
        changing = max(second.accel_std.tolist()) > _ROUNDING
        self.state.alive |= changing
        return (changing or not self.state.alive) and self.knobs.weakest < second.accel_strength < self.knobs.strongest

    def heard(self, receipt: Receipt) -> None:
        """Note what gravity said of a second."""
        against = receipt.test_ratio > 1
        state = self.state
        state.row = state.row + 1 if against else 0
        state.balance = max(0, state.balance + (1 if against else -1))
        state.disbelieved |= state.balance >= self.knobs.patience

    def anew(self) -> None:
        """What was believed so far is no more: nothing speaks against what is believed now."""
        self.state.balance = self.state.row = 0

    @property
    def contradicts(self) -> bool:
        """Whether it has been against what is believed for some seconds now."""
        return self.state.row >= self.knobs.in_a_row and not self.state.disbelieved
