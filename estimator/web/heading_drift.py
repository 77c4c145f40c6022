"""Heading drift: difference of the headings integrated from raw and from corrected rates. Pure."""

from collections import deque
from dataclasses import dataclass
from math import atan2, cos, nan, pi, remainder, sin

import numpy as np

from bridge.wire.messages import Floats
from estimator.geometry import rotation
from estimator.web.traces import BACK_S, KEPT_S, Pair

#: a pause this long loses the attitude, which starts anew, s
TORN_S = 0.5
#: most points kept, and interval between points, s
POINTS, POINT_S = 900, 1.0
#: span of accelerometer readings before the start that determine the vertical, s
_UP_S = 1.0


@dataclass(frozen=True, slots=True)
class Lost:
    """Heading error of raw rates at one moment.

    time_s: host time, s since the Unix epoch. read: angle from the heading by corrected rates to the heading by raw
    rates, rad.
    zeroed: the same angle for raw rates minus the bias at the start, rad.
    std: standard deviation of the corrected heading due to the uncertain bias alone, rad.
    """

    time_s: float
    read: float
    zeroed: float
    std: float


_NOTHING = Lost(0.0, 0.0, 0.0, 0.0)


class Heading:
    """Heading error of one device's raw rates against its corrected rates, since the last restart.

    Both rates are integrated to attitudes. The heading error is the angle between them about the vertical, which the
    accelerometer gives at the start. Without an accelerometer it is the whole angle between the two attitudes.
    points: errors, one a second. since_s: host time of the start, s since the Unix epoch; 0 before the first sample.
    """

    def __init__(self) -> None:
        self.points: deque[Lost] = deque(maxlen=POINTS)
        self.since_s = 0.0
        self._boot, self._latest_s = 0, -np.inf
        self._asked_s = 0.0
        self._accel: deque[tuple[float, Floats]] = deque()
        #: (3, 3, 3) attitudes by corrected rates, by raw rates, and by raw rates less the first bias
        self._attitudes: Floats
        self._bias: Floats
        self._up: Floats | None
        self._anew()

    @property
    def vertical(self) -> bool:
        """True if the vertical is known, from the accelerometer at the start."""
        return self._up is not None

    @property
    def turned(self) -> float:
        """Angle between the present attitude and that at the start, by corrected rates, 0 to π rad."""
        return float(np.linalg.norm(rotation.log(self._attitudes[0])))

    @property
    def now(self) -> Lost:
        """Latest heading error; all zero before the first."""
        return self.points[-1] if self.points else _NOTHING

    def restart(self, at_s: float) -> None:
        """Delete all points, and start again at host time `at_s`, s since the Unix epoch, such as the start of a rest.

        A second call with the same time changes nothing.
        """
        if at_s != self._asked_s:
            self._asked_s = at_s
            self._anew()

    def add(self, pair: Pair) -> None:
        """Integrate the rates of new samples, and add a point each second.

        An uncorrected sample, a new boot, or a gap of 0.5 s restarts the integration and deletes all points.
        Samples from up to KEPT_S seconds before the time of `restart` are not integrated. They are older samples, which
        a new subscriber receives at once.
        """
        if not np.isfinite(pair.corrected).all() or pair.boot != self._boot:
            self._boot = pair.boot
            self._accel.clear()
            self._anew()
            if not np.isfinite(pair.corrected).all():
                return
        # Samples from long before count: the clock is then behind the one that reports rests.
        if self._asked_s - KEPT_S <= pair.time_s[-1] < self._asked_s:
            self._feel(pair)
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
        # A wrong bias is wrong all the time: its angle grows with time, not with the root of time.
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
        """Angle about the vertical from the corrected attitude to another, unwrapped from its previous value; rad."""
        vector = rotation.log(self._attitudes[which] @ self._attitudes[0].T)
        angle = float(np.linalg.norm(vector))
        if self._up is None or angle == 0:
            return angle
        # The part of a rotation about one axis: its quaternion without the components across that axis.
        about = 2 * atan2(sin(angle / 2) * float(vector @ self._up) / angle, cos(angle / 2))
        return before + remainder(about - before, 2 * pi)

    def _anew(self) -> None:
        self._attitudes = np.tile(np.eye(3), (3, 1, 1))
        self._bias, self._up = np.full(3, nan), None
        self._latest_s, self.since_s = -np.inf, 0.0
        self.points.clear()
