"""The bias of one boot, from its first rest on: the filter, the evidence that feeds it, and whether it is to be doubted."""

from collections import deque
from dataclasses import dataclass, field
from math import degrees

import numpy as np
from numpy.typing import NDArray

from estimator.stillness import Window
from estimator.track.bias_filter import BiasFilter, BiasKnobs, BiasState, Receipt
from estimator.track.zaru import Zaru, ZaruKnobs

Floats = NDArray[np.float64]

#: how often an uncertainty that grows without evidence is told anew, device seconds
PREDICT_S = 1.0
#: temperatures kept, for bringing a rest's bias from then to now
_TEMPERATURES = 1000


@dataclass(frozen=True, slots=True)
class TrackKnobs:
    """When a bias is doubted. Device seconds, rad/s."""

    #: without an accepted rest for this long, or with a bias less certain than this
    evidence_age_s: float = 1800.0
    bias_std: float = np.radians(0.2)
    #: or after so many refused rests in a row
    contradictions: int = 5
    bias: BiasKnobs = field(default_factory=BiasKnobs)
    zaru: ZaruKnobs = field(default_factory=ZaruKnobs)


@dataclass(frozen=True, slots=True, eq=False)
class RestBias:
    """A rest as a measurement of the bias: mean (3,) rad/s, its covariance (3, 3), the variance (3,) its readings share.

    middle and end in device seconds.
    """

    bias: Floats
    cov: Floats
    common_var: Floats
    middle: float
    end: float


class Tracker:
    """Windows in; the bias, and a reason to doubt or to trust it, out. Nothing is tracked before a first rest."""

    def __init__(self, knobs: TrackKnobs, began: float) -> None:
        self.knobs = knobs
        #: kept beside the state of life: a device that is being recalibrated is no better than it was before
        self.doubted = False
        self.last_receipt: Receipt | None = None
        self._filter: BiasFilter | None = None
        self._zaru = Zaru(knobs.zaru)
        self._temperatures: deque[tuple[float, float]] = deque(maxlen=_TEMPERATURES)
        self._contradictions = 0
        self._evidence_time = began

    @property
    def state(self) -> BiasState | None:
        """The bias as it is believed now; None before the first rest."""
        return self._filter.state if self._filter else None

    @property
    def temperature_c(self) -> float:
        """The latest temperature, NaN when unknown."""
        return self._temperatures[-1][1] if self._temperatures else float("nan")

    def evidence_age(self, now: float) -> float:
        """Seconds since a rest was last accepted, or since the boot."""
        return now - self._evidence_time

    def temperature(self, time: float, celsius: float) -> None:
        """Note a temperature."""
        self._temperatures.append((time, celsius))

    def first_rest(self, rest: RestBias) -> None:
        """Begin with the first rest; later ones come as windows."""
        if self._filter is None:
            state = BiasState(rest.bias, self._cov(rest), rest.middle, self._temperature_at(rest.middle))
            self._filter = BiasFilter(state, self.knobs.bias)
            self._evidence_time = rest.end

    def calibrated(self, bias: Floats, cov: Floats, time: float, rest: RestBias) -> None:
        """Begin anew from a calibration: bias (3,) with covariance (3, 3) at a time, and the rest after the last turn."""
        kf = self._filter = BiasFilter(BiasState(bias, cov, time, self._temperature_at(time)), self.knobs.bias)
        if time < rest.middle:
            # That rest is newer than the one the bias came from.
            kf.predict(rest.middle, self._temperature_at(rest.middle))
            kf.update("zaru", rest.bias, self._cov(rest), rest.common_var)
        kf.predict(rest.end, self._temperature_at(rest.end))
        self._evidence_time = rest.end
        self._contradictions, self.doubted = 0, False

    def restored(self, state: BiasState, now: float) -> None:
        """Go on from a state that was kept."""
        self._filter = BiasFilter(state, self.knobs.bias)
        self._filter.predict(now)
        self._evidence_time = min(state.time, now)

    def window(self, window: Window) -> Receipt | None:
        """Take the next window; a receipt when it completes a piece of rest."""
        if self._filter is None:
            return None
        if window.end_time - self._filter.state.time >= PREDICT_S:
            self._filter.predict(window.end_time, self.temperature_c)
        receipt = self._zaru.window(window, self._filter, self.temperature_c)
        if receipt is not None:
            self.last_receipt = receipt
            self._contradictions = 0 if receipt.accepted else self._contradictions + 1
            if receipt.accepted:
                self._evidence_time = receipt.time
        return receipt

    def doubt(self, now: float) -> str | None:
        """Why the bias is doubted from now on, in words; None when that is no news, or there is no reason."""
        reason = None
        age = self.evidence_age(now)
        if self.last_receipt is not None and self._contradictions >= self.knobs.contradictions:
            by = degrees(float(np.max(np.abs(self.last_receipt.innovation))))
            reason = f"at rest it reads {by:.2f} °/s off: turning slowly, or the bias jumped"
        elif self._filter is not None and age > self.knobs.evidence_age_s:
            reason = f"no rest for {age / 60:.0f} minutes"
        if reason is None or self.doubted:
            return None
        self.doubted = True
        return reason

    def trust(self) -> bool:
        """Whether the last rest has made the bias certain again."""
        receipt, state = self.last_receipt, self.state
        if receipt is None or state is None or not receipt.accepted or np.any(state.std >= self.knobs.bias_std):
            return False
        self.doubted = False
        return True

    def _cov(self, rest: RestBias) -> Floats:
        return rest.cov + self.knobs.zaru.quasi_static**2 * np.eye(3)

    def _temperature_at(self, time: float) -> float:
        if not self._temperatures:
            return float("nan")
        times, values = zip(*self._temperatures, strict=True)
        return float(np.interp(time, times, values))
