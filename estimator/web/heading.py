"""How far the attitude by raw rates comes away from that by corrected rates. Pure."""

from collections import deque

import numpy as np

from bridge.wire.messages import Floats
from estimator import rotation
from estimator.web.traces import Pair

#: a pause so long tears the attitude: it begins anew
TORN_S = 0.5
#: one point a second
POINTS, POINT_S = 900, 1.0


class Heading:
    """Both attitudes of one device, from `restart` on. Angles in rad."""

    def __init__(self) -> None:
        #: host time, how far raw is from corrected, how far corrected may be from the truth by its bias alone (1 σ)
        self.points: deque[tuple[float, float, float]] = deque(maxlen=POINTS)
        self.since_s = 0.0
        self._boot, self._latest_s = 0, -np.inf
        self._asked_s = 0.0
        self._raw = self._corrected = np.eye(3)
        self._var: Floats = np.zeros(3)

    @property
    def apart(self) -> float:
        """The angle between the two attitudes now."""
        return float(np.linalg.norm(rotation.log(self._corrected.T @ self._raw)))

    @property
    def turned(self) -> float:
        """How far the device has turned, by the corrected rates, from where it began."""
        return float(np.linalg.norm(rotation.log(self._corrected)))

    @property
    def std(self) -> float:
        """What the uncertainty of the bias alone has made of the corrected attitude: its largest axis."""
        return float(np.sqrt(self._var.max()))

    def restart(self, at_s: float) -> None:
        """Begin anew from a moment of host time, such as the beginning of a rest; one that was told already changes nothing."""
        if at_s > self._asked_s:
            self._asked_s = at_s
            self._anew()

    def add(self, pair: Pair) -> None:
        """Go on by some samples; what is not corrected, or torn, begins anew."""
        if not np.isfinite(pair.corrected).all() or pair.boot != self._boot:
            self._boot = pair.boot
            self._anew()
            if not np.isfinite(pair.corrected).all():
                return
        dt = np.diff(pair.device_s, prepend=self._latest_s)
        if not 0 < dt[0] < TORN_S:
            if np.isfinite(dt[0]) and dt[0] <= 0:
                return
            self._anew()
            dt[0] = np.median(dt[1:]) if len(dt) > 1 else 0.0
        if not self.since_s:
            self.since_s = float(pair.time_s[0])
        self._latest_s = float(pair.device_s[-1])
        self._raw = self._raw @ rotation.attitudes(pair.raw, dt)[-1]
        self._corrected = self._corrected @ rotation.attitudes(pair.corrected, dt)[-1]
        # A bias that is wrong is wrong for the whole time: its angle grows with time, not with its root.
        elapsed_s = pair.time_s[-1] - self.since_s
        self._var = (pair.bias_std * elapsed_s) ** 2
        now_s = float(pair.time_s[-1])
        if not self.points or now_s - self.points[-1][0] >= POINT_S:
            self.points.append((now_s, self.apart, self.std))

    def _anew(self) -> None:
        self._raw = self._corrected = np.eye(3)
        self._var = np.zeros(3)
        self._latest_s, self.since_s = -np.inf, 0.0
        self.points.clear()
