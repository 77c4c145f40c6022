"""How far the heading by raw rates comes away from that by corrected rates. Pure."""

from collections import deque
from dataclasses import dataclass, replace
from math import atan2, cos, nan, pi, remainder, sin

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import Floats
from estimator.geometry import rotation
from estimator.web.traces import BACK_S, KEPT_S, Pair

#: a pause so long tears the attitude: it begins anew
TORN_S = 0.5
#: one point a second
POINTS, POINT_S = 900, 1.0
#: seconds of the accelerometer, before it begins anew, that say which way is up
_UP_S = 1.0


@dataclass(frozen=True, slots=True)
class Lost:
    """What the heading has lost at one moment of host time; rad.

    read, zeroed: how far from that by corrected rates it is by raw ones, and by raw ones less the bias they had at first.
    std: how far the corrected one may be from the truth by its bias alone, 1 σ.
    """

    time_s: float
    read: float
    zeroed: float
    std: float


_NOTHING = Lost(0.0, 0.0, 0.0, 0.0)


class Heading:
    """One device, from `restart` on.

    The heading is the turn about the vertical, which its accelerometer tells at the beginning; without one it is the whole
    angle between two attitudes.
    """

    def __init__(self) -> None:
        self.points: deque[Lost] = deque(maxlen=POINTS)
        self.since_s = 0.0
        self._boot, self._latest_s = 0, -np.inf
        self._asked_s = 0.0
        self._accel: deque[tuple[float, Floats]] = deque()
        #: (3, 3, 3) by corrected rates, by raw ones, and by raw ones less the first bias
        self._attitudes: Floats
        self._bias: Floats
        self._up: Floats | None
        self._anew()

    @property
    def vertical(self) -> bool:
        """Whether it is known which way is up."""
        return self._up is not None

    @property
    def turned(self) -> float:
        """How far the device has turned, by the corrected rates, from where it began."""
        return float(np.linalg.norm(rotation.log(self._attitudes[0])))

    @property
    def now(self) -> Lost:
        """The last point."""
        return self.points[-1] if self.points else _NOTHING

    def restart(self, at_s: float) -> None:
        """Begin anew from a moment of host time, such as the beginning of a rest; the same again changes nothing."""
        if at_s != self._asked_s:
            self._asked_s = at_s
            self._anew()

    def add(self, pair: Pair) -> None:
        """Go on by some samples; what is not corrected, or torn, begins anew.

        Of the last seconds, which come at once to who has just begun to listen, those before `restart` count for nothing.
        """
        if not np.isfinite(pair.corrected).all() or pair.boot != self._boot:
            self._boot = pair.boot
            self._accel.clear()
            self._anew()
            if not np.isfinite(pair.corrected).all():
                return
        # Not those long before: then it is a clock that is behind the one which tells of rests.
        counts = (pair.time_s >= self._asked_s) | (pair.time_s < self._asked_s - KEPT_S)
        if not counts.all():
            self._feel(pair)
            pair = _only(pair, counts)
            if not len(pair.time_s):
                return
        dt = np.diff(pair.device_s, prepend=self._latest_s)
        back = pair.time_s[-1] < (self.now.time_s or self.since_s) - BACK_S
        if back or not 0 < dt[0] < TORN_S:
            if np.isfinite(dt[0]) and dt[0] <= 0:
                return
            self._anew()
            dt[0] = np.median(dt[1:]) if len(dt) > 1 else 0.0
        self._latest_s = float(pair.device_s[-1])
        self._feel(pair)
        if not self.since_s:
            self._begin(pair)
        rates = np.stack([pair.corrected, pair.raw, pair.raw - self._bias])
        self._attitudes = self._attitudes @ rotation.attitudes(rates, dt)[:, -1]
        now_s = float(pair.time_s[-1])
        if self.points and now_s - self.points[-1].time_s < POINT_S:
            return
        # A bias that is wrong is wrong for the whole time: its angle grows with time, not with its root.
        bias_std = pair.bias_std.max() if self._up is None else np.linalg.norm(self._up * pair.bias_std)
        read, zeroed = (self._apart(which, before) for which, before in ((1, self.now.read), (2, self.now.zeroed)))
        self.points.append(Lost(now_s, read, zeroed, float(bias_std) * (now_s - self.since_s)))

    def _feel(self, pair: Pair) -> None:
        if pair.accel is not None:
            self._accel.append((float(pair.time_s[-1]), pair.accel))
        while self._accel and pair.time_s[-1] - self._accel[0][0] > _UP_S:
            self._accel.popleft()

    def _begin(self, pair: Pair) -> None:
        self.since_s, self._bias = float(pair.time_s[0]), pair.bias
        felt = np.sum([accel for _, accel in self._accel], axis=0) if self._accel else np.zeros(3)
        size = float(np.linalg.norm(felt))
        self._up = felt / size if size > 0 else None

    def _apart(self, which: int, before: float) -> float:
        """How far one attitude is turned from the corrected one about the vertical, unwrapped from what it was before."""
        vector = rotation.log(self._attitudes[which] @ self._attitudes[0].T)
        angle = float(np.linalg.norm(vector))
        if self._up is None or angle == 0:
            return angle
        # The part of a rotation that is about one axis: its quaternion, without what stands across that axis.
        about = 2 * atan2(sin(angle / 2) * float(vector @ self._up) / angle, cos(angle / 2))
        return before + remainder(about - before, 2 * pi)

    def _anew(self) -> None:
        self._attitudes = np.tile(np.eye(3), (3, 1, 1))
        self._bias, self._up = np.full(3, nan), None
        self._latest_s, self.since_s = -np.inf, 0.0
        self.points.clear()


def _only(pair: Pair, counts: NDArray[np.bool_]) -> Pair:
    return replace(
        pair,
        **{name: getattr(pair, name)[counts] for name in ("device_s", "time_s", "raw", "corrected", "std")},
    )
