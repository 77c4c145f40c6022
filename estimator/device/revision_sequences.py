"""Sequence numbers and times of the latest one-second blocks, from which revisions of past biases are built."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Code
from bridge.wire.messages import BiasRevision
from estimator.tracking.smoother import Smoothed

#: number of seconds remembered
REVISED_S = 2000


class RevisionSequences:
    """Record of the latest one-second blocks that the bias tracker used in one boot, at most REVISED_S blocks.

    For the last sample of each block: device time (s), sequence number, and host time (ns since the Unix epoch).
    """

    def __init__(self) -> None:
        self._seconds: deque[tuple[float, int, int]] = deque(maxlen=REVISED_S)

    def note(self, end: float, sequence: int, time_ns: int) -> None:
        """Record the last sample of a one-second block that the bias tracker has used.

        end: device time, s. sequence: sequence number. time_ns: host time, ns since the Unix epoch.
        """
        self._seconds.append((end, sequence, time_ns))

    @property
    def reached(self) -> tuple[int, int] | None:
        """Sequence number and host time, ns since the Unix epoch, of the last sample of the latest block.

        None before the first block.
        """
        return self._seconds[-1][1:] if self._seconds else None

    def revision(
        self,
        of: tuple[str, int],
        time_ns: int,
        calibration: str,
        matrix: NDArray[np.float64],
        gap_s: float,
        smoothed: Smoothed,
    ) -> BiasRevision | None:
        """Build the message that revises past biases, after a period without measurements of the bias.

        of: device id and boot id. time_ns: host time, ns since the Unix epoch, at which the revision became known.
        calibration, matrix (3, 3): id and matrix of the gyro model in use. gap_s: length of the period, s.
        smoothed: smoothed biases (rad/s) at the device times of block ends. Blocks that are no longer recorded are left
        out.
        Returns None if no block is left.
        """
        known = {time: (sequence, time_ns) for time, sequence, time_ns in self._seconds}
        kept = [i for i, time in enumerate(smoothed.time) if time in known]
        if not kept:
            return None
        sequences, times_ns = zip(*(known[smoothed.time[i]] for i in kept), strict=True)
        return BiasRevision(
            device=of[0],
            boot=of[1],
            calibration=calibration,
            time_ns=time_ns,
            matrix=matrix,
            sequences=np.array(sequences, np.uint64),
            times_ns=np.array(times_ns, np.int64),
            bias=smoothed.bias[kept].astype(np.float32),
            bias_std=smoothed.std[kept].astype(np.float32),
            reason=(Code.AT_REST_AGAIN(gap_s=f"{gap_s:.0f}"),),
        )
