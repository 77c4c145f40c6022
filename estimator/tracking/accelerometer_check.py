"""Accelerometer check: whether its readings can be used, or it is dead, frozen or wrongly scaled.

A mirrored or swapped accelerometer looks right by itself, but repeatedly contradicts gravity carried by the gyro.
"""

from dataclasses import dataclass

from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt
from estimator.tracking.seconds import Second

#: m/s²; identical readings deviate less than this from their mean, by rounding
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class AccelerometerKnobs:
    """Limits within which an accelerometer counts as usable."""

    #: m/s², limits of a second's mean reading; a wearer's movement stays within them
    weakest: float = 5.0
    strongest: float = 20.0
    #: contradicting minus agreeing seconds after which it is given up for this boot
    patience: int = 30
    #: contradicting seconds in a row that mean a fault, of the accelerometer or the bias
    in_a_row: int = 5
    #: relative; a less certain scale moves gravity more in a turn than a wrong bias does
    scale_std: float = 0.05


class AccelerometerState(StateStruct):
    """State of the accelerometer check.

    balance: contradicting minus agreeing seconds, at least 0. row: contradicting seconds in a row. disbelieved: whether
    the accelerometer is given up for this boot. alive: whether the readings have ever changed.
    """

    disbelieved: bool = False
    balance: int = 0
    row: int = 0
    alive: bool = False


class AccelerometerCheck:
    """Accelerometer check: seconds and receipts of gravity's evidence in; whether to use the accelerometer out."""

    def __init__(self, knobs: AccelerometerKnobs | None = None) -> None:
        self.knobs = knobs or AccelerometerKnobs()
        self.state = AccelerometerState()

    def fit(self, second: Second) -> bool:
        """Whether the accelerometer can be used in the next second.

        False when there is none, when it was given up or is frozen, or when its mean magnitude is outside the plausible
        range.
        """
        fit = self._fit(second)
        if not fit:
            self.state.row = 0  # a silent or frozen accelerometer contradicts nothing
        return fit

    def _fit(self, second: Second) -> bool:
        if self.state.disbelieved or second.accel is None or second.accel_std is None:
            return False
        changing = max(second.accel_std.tolist()) > _ROUNDING
        self.state.alive |= changing
        return (changing or not self.state.alive) and self.knobs.weakest < second.accel_strength < self.knobs.strongest

    def heard(self, receipt: Receipt) -> None:
        """Count one second's receipt of gravity's evidence.

        A test ratio above 1 contradicts the gyro, any other agrees.
        """
        against = receipt.test_ratio > 1
        state = self.state
        state.row = state.row + 1 if against else 0
        state.balance = max(0, state.balance + (1 if against else -1))
        state.disbelieved |= state.balance >= self.knobs.patience

    def anew(self) -> None:
        """Reset the counts of contradictions, because the bias has been started anew."""
        self.state.balance = self.state.row = 0

    @property
    def contradicts(self) -> bool:
        """Whether the accelerometer has contradicted the bias for `in_a_row` seconds in a row.

        False once it is given up.
        """
        return self.state.row >= self.knobs.in_a_row and not self.state.disbelieved
