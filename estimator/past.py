"""Which samples the tracker's seconds ended with, so that what is learnt of the past can be told in sequence numbers."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import BiasRevision, SampleBatch
from estimator.block import Stretch, sample_time_ns, where
from estimator.track.smoother import Smoothed

#: seconds whose samples are remembered; windows that may wait until the tracker has judged them
REVISED_S, _WINDOWS = 2000, 32


class Past:
    """Of one boot: device time, sequence number and host time of samples."""

    def __init__(self) -> None:
        self._windows: deque[tuple[float, SampleBatch | Stretch, int]] = deque(maxlen=_WINDOWS)
        self._seconds: deque[tuple[float, int, int]] = deque(maxlen=REVISED_S)

    def note(self, now: float, of: SampleBatch | Stretch, index: int, tracked: float) -> None:
        """A window ended at device time `now` with this sample of a batch or stretch; the tracker is at device time `tracked`."""
        waiting = self._windows
        waiting.append((now, of, index))
        while waiting and waiting[0][0] <= tracked:
            end, last, at = waiting.popleft()
            if end == tracked:
                self._seconds.append((end, last.sequence + at, sample_time_ns(*where(last, at))))

    @property
    def reached(self) -> tuple[int, int] | None:
        """Sequence number and host time of the last sample that the tracker knows of; None before there is one."""
        return self._seconds[-1][1:] if self._seconds else None

    def revision(
        self, batch: SampleBatch, calibration: str, matrix: NDArray[np.float64], gap_s: float, smoothed: Smoothed
    ) -> BiasRevision | None:
        """A better past for those who keep it: the seconds of a gap of which the samples are still known, or None."""
        known = {time: (sequence, time_ns) for time, sequence, time_ns in self._seconds}
        kept = [i for i, time in enumerate(smoothed.time) if time in known]
        if not kept:
            return None
        sequences, times_ns = zip(*(known[smoothed.time[i]] for i in kept), strict=True)
        return BiasRevision(
            device=batch.device,
            boot=batch.boot,
            calibration=calibration,
            time_ns=batch.receive_time_ns,
            matrix=matrix,
            sequences=np.array(sequences, np.uint64),
            times_ns=np.array(times_ns, np.int64),
            bias=smoothed.bias[kept].astype(np.float32),
            bias_std=smoothed.std[kept].astype(np.float32),
            reason=f"at rest again after {gap_s:.0f} s",
        )
