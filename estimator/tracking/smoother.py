"""Rauch-Tung-Striebel smoother, by filterpy: estimates each earlier bias (rad/s) with the evidence that came later.

For each second it stores the filter's state after all updates, and the prediction step from the second before. Of the
state it keeps the bias (3) rad/s and its slope by temperature (3) rad/s/K.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from estimator.tracking.bias_filter import Step
from estimator.tracking.bias_state import BIAS, OWN, Floats

_NOTHING = np.zeros(OWN)
_P, _F, _Q = slice(1, 1 + OWN), slice(1 + OWN, 1 + 2 * OWN), slice(1 + 2 * OWN, None)


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Smoothed bias (m, 3), rad/s, at m device times (m,), s, with standard deviation std (m, 3), rad/s."""

    time: Floats
    bias: Floats
    std: Floats


@dataclass(slots=True, eq=False)
class _Step:
    """One second: rows (19, 6) of x, P, and F and Q of the step that led to it, stacked."""

    time: float
    rows: Floats
    known: Floats  # deterministic part of x: the smoother has no control input


class History:
    """Buffer of filter steps for smoothing, one step a second.

    most: largest number of steps, None without a limit. Beyond it, neighbouring steps are merged in pairs.
    """

    def __init__(self, most: int | None = None) -> None:
        self._most = most
        self._steps: list[_Step] = []

    def __len__(self) -> int:
        return len(self._steps)

    def add(self, time: float, x: Floats, P: Floats, step: Step, bent: Floats | None = None) -> None:
        """Store the filter's state x (n,) and covariance P (n, n) at a device time, s, and the step that predicted them.

        x: bias (3) rad/s, slope by temperature (3) rad/s/K, then appended states; the first 6 are kept.
        step: prediction step with F and Q (n, n).
        bent (6,): known change that the prediction added to the first 6 states, in their units, or None.
        """
        known = self._steps[-1].known if self._steps else _NOTHING
        F = step.F[:OWN, :OWN]
        known = known if known is _NOTHING else F @ known
        known = known if bent is None else known + bent
        rows = np.empty((1 + 3 * OWN, OWN))
        rows[0], rows[_P], rows[_F], rows[_Q] = x[:OWN] - known, P[:OWN, :OWN], F, step.Q[:OWN, :OWN]
        self._steps.append(_Step(time, rows, known))
        if self._most is not None and len(self._steps) > self._most:
            self._thin()

    def doubt(self, cov: Floats, since: float, now: float) -> None:
        """Enlarge the stored variance of the bias walk by a covariance (3, 3), (rad/s)², from device time `since` to `now`, s.

        The covariance is spread evenly over the steps in this time. With since -inf, it is added to the covariance of
        every stored state instead.
        """
        if np.isneginf(since):
            for step in self._steps:
                step.rows[_P][BIAS, BIAS] += cov
            return
        before = since
        for step in self._after(since):
            step.rows[_P][BIAS, BIAS] += cov * (step.time - since) / (now - since)
            step.rows[_Q][BIAS, BIAS] += cov * (step.time - before) / (now - since)
            before = step.time

    def smoothed(self, since: float = -np.inf) -> Smoothed | None:
        """Smoothed bias at every stored step after device time `since`, s; None without steps."""
        steps = self._after(since)
        if not steps:
            return None
        rows, known = np.array([step.rows for step in steps]), np.array([step.known for step in steps])
        x, P = rows[:, 0], rows[:, _P]
        if len(steps) > 1:
            from filterpy.kalman import rts_smoother  # noqa: PLC0415 - as in bias_filter.py

            # Without temperature the slope is known exactly, which would make P singular.
            P = P + 1e-24 * np.eye(OWN)
            onward = steps[1:]
            x, P, _, _ = rts_smoother(x, P, [s.rows[_F] for s in onward], [s.rows[_Q] for s in onward])
        std = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2)[:, BIAS], 0.0))
        return Smoothed(np.array([step.time for step in steps]), (x + known)[:, BIAS], std)

    def _after(self, since: float) -> list[_Step]:
        return self._steps[bisect_right(self._steps, since, key=lambda step: step.time) :]

    def _thin(self) -> None:
        kept = self._steps[:1]
        for first, second in zip(self._steps[1::2], self._steps[2::2], strict=False):
            second.rows[_Q] = second.rows[_F] @ first.rows[_Q] @ second.rows[_F].T + second.rows[_Q]
            second.rows[_F] = second.rows[_F] @ first.rows[_F]
            kept.append(second)
        if len(self._steps) % 2 == 0:
            kept.append(self._steps[-1])
        self._steps = kept
