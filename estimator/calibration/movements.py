"""Movements of a session through which gravity can be propagated, full turns or not; only the latest are kept."""

from dataclasses import replace

import numpy as np

from estimator.calibration.capture import Movement
from estimator.calibration.clipping import clipped
from estimator.calibration.turn_recognition import GAP_S, same_bias

#: number of movements kept: more than any procedure needs, 20 MB at 1 kHz
MOST = 64
#: s, longest movement kept: the error of its angle is that of the bias times its duration
LONGEST_S = 30.0
#: rad, largest total rotation kept: more means two movements with an unrecognised rest between, which may hide errors
LONGEST_WAY = 1.5 * 2 * np.pi
#: s; movements this much older than the newest, or at a different bias, are not combined with it
STALE_S = 600.0


class Movements:
    """Bounded collection of the latest movements between rests, as input of a calibration by movements.

    gyro_range: full-scale range, rad/s; infinite when unknown. The limits of turn recognition for gaps and bias steps apply.
    """

    def __init__(self, gyro_range: float) -> None:
        self._gyro_range = gyro_range
        #: all kept movements in the order of time
        self.kept: list[Movement] = []

    def add(self, movement: Movement, *, full_turn: bool) -> bool:
        """Keep a movement if gravity can be propagated through it; return whether it was kept.

        Propagation needs an accelerometer at both rests, no clipped or missing samples, at most 30 s and 1.5 turns, and
        one bias. Movements that are too old for it, or of another bias, are dropped. full_turn: whether it is known to
        have ended where it began.
        """
        if movement.before.accel is None or movement.after.accel is None or not self._whole(movement):
            return False
        newest = movement.before
        self.kept = [
            kept
            for kept in self.kept[-(MOST - 1) :]
            if newest.end - kept.after.end < STALE_S and same_bias(kept.before, newest)
        ]
        self.kept.append(replace(movement, full_turn=full_turn))
        return True

    def _whole(self, movement: Movement) -> bool:
        time = movement.samples.time
        if (
            clipped(movement.samples, movement.before.std, self._gyro_range).any()
            or movement.after.start - movement.before.end > LONGEST_S
            or len(time) < 3
        ):
            return False
        steps = np.diff(time)
        way = np.linalg.norm(movement.samples.gyro[1:] - movement.before.bias, axis=1) @ steps
        reached = time[0] <= movement.before.end and time[-1] >= movement.after.start
        calm = same_bias(movement.before, movement.after)
        return bool(
            reached and calm and way <= LONGEST_WAY and steps.max() <= max(GAP_S, 2.5 * float(np.median(steps)))
        )
