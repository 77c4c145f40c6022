"""Accelerometer check: detects a dead, frozen or wrongly scaled accelerometer, so that tracking does not use it.

The readings of a mirrored or swapped accelerometer look plausible by themselves. They repeatedly contradict gravity
propagated by the gyro.
"""

from estimator.state import StateStruct
from estimator.tracking.evidence import Receipt
from estimator.tracking.seconds import Second

#: m/s²; identical readings deviate less than this from their mean, by rounding
_ROUNDING = 1e-9

#: m/s², limits of a second's mean reading; a wearer's movement stays within them
_WEAKEST, _STRONGEST = 5.0, 20.0
#: contradicting minus agreeing seconds after which it is given up for this boot
_PATIENCE = 30
#: contradicting seconds in a row that mean a fault, of the accelerometer or the bias
_IN_A_ROW = 5
#: relative; a less certain scale moves gravity more in a turn than a wrong bias does
SCALE_STD = 0.05


class AccelerometerCheck(StateStruct):
    """Accelerometer check: decides if tracking uses the accelerometer, from its readings and from the gravity evidence.

    The input comes in blocks of one second (`Second`), and in receipts of the gravity evidence of these blocks. A block
    contradicts the bias if the test ratio of its receipt is above 1, else it agrees.
    balance: number of contradicting blocks minus number of agreeing blocks, at least 0.
    row: number of contradicting blocks in a row.
    disbelieved: True if the accelerometer is not used for the rest of this boot.
    alive: True once the readings have changed.
    """

    disbelieved: bool = False
    balance: int = 0
    row: int = 0
    alive: bool = False

    def fit(self, second: Second) -> bool:
        """Return True if the accelerometer readings of a one-second block can be used.

        False without accelerometer readings, for a frozen accelerometer, and for one given up for this boot. False also
        when the mean magnitude of the readings is outside 5 to 20 m/s².
        """
        fit = self._fit(second)
        if not fit:
            self.row = 0  # a silent or frozen accelerometer contradicts nothing
        return fit

    def _fit(self, second: Second) -> bool:
        if self.disbelieved or second.accel is None or second.accel_std is None:
            return False
        changing = max(second.accel_std.tolist()) > _ROUNDING
        self.alive |= changing
        return (changing or not self.alive) and _WEAKEST < second.accel_strength < _STRONGEST

    def heard(self, receipt: Receipt) -> None:
        """Count the receipt of the gravity evidence of one block as a contradiction or as an agreement.

        A test ratio above 1 is a contradiction, any other an agreement. The accelerometer is given up at 30 more
        contradictions than agreements.
        """
        against = receipt.test_ratio > 1
        self.row = self.row + 1 if against else 0
        self.balance = max(0, self.balance + (1 if against else -1))
        self.disbelieved |= self.balance >= _PATIENCE

    def anew(self) -> None:
        """Reset the counts of contradictions, when tracking restarts from a new bias."""
        self.balance = self.row = 0

    @property
    def contradicts(self) -> bool:
        """True if the last five or more one-second blocks contradicted the bias; False for an accelerometer given up."""
        return self.row >= _IN_A_ROW and not self.disbelieved
