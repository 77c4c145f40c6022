"""A tracker fed as a session feeds it, with what it believed second by second."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.sim.imu_errors import ImuSpec
from bridge.sim.motion import Still
from estimator.geometry.gyro_model import Floats, GyroModel
from estimator.stillness.detector import Stillness, Windows
from estimator.tracking.bias_state import BiasKnobs
from estimator.tracking.evidence import Receipt
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.tracker import Tracker
from tests.estimator.stream import Stream, stream

#: nothing wrong with it but the bias and white noise
PLAIN = ImuSpec(scale=(1.0, 1.0), bias_limit_dps=2.0)
KNOBS = TrackKnobs(bias=BiasKnobs(warm_up_walk=0.0))
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def model(bias: Floats | None = None, scale_std: float = 1e-4, cross_std: float = 1e-4) -> GyroModel:
    """A gyro whose matrix is known."""
    bias = np.zeros(3) if bias is None else bias
    return GyroModel(np.eye(3), bias, np.full(3, scale_std), np.full(3, cross_std), np.full(3, 5e-4))


def rest(seconds: float, *, seed: int = 0, noise_dps: float = 0.03, spec: ImuSpec = PLAIN) -> Stream:
    """A device that lies flat."""
    return stream([Still(seconds)], seconds, seed=seed, spec=replace(spec, noise_dps=noise_dps), attitude=LEVEL)


def learnt(tracker: Tracker, windows: Windows) -> Iterator[tuple[float, list[Receipt]]]:
    """Feed windows one by one; yields after each its end, s, and the receipts of the seconds that it completed."""
    for i, (_, now, _, _) in enumerate(windows.heads):
        seconds = tracker.seconds.take(windows.part(i, i + 1))
        yield now, [receipt for _, second in seconds for receipt in tracker.learn(second)]


@dataclass(slots=True, eq=False)
class Worn:
    """A device and its tracker; `bias`, `std` (m, 3) and `time` (m,) after each of the windows it was fed."""

    tracker: Tracker
    stillness: Stillness
    receipts: list[Receipt]
    time: list[float]
    bias: list[Floats]
    std: list[Floats]

    @staticmethod
    def new(
        bias: Floats | None = None, bias_std_dps: float = 5.0, knobs: TrackKnobs = KNOBS, gyro: GyroModel | None = None
    ) -> "Worn":
        """From what is believed of the bias, rad/s, with a deviation in °/s."""
        tracker = Tracker(knobs, 0.0, gyro or model(bias), np.full(3, np.radians(bias_std_dps)))
        return Worn(tracker, Stillness(), [], [], [], [])

    def lives(
        self,
        of: Stream,
        *,
        accel: bool = True,
        temperature: bool = False,
        edges: Sequence[int] | None = None,
        clipped: NDArray[np.bool_] | None = None,
    ) -> "Worn":
        """Take all of a stream, cut before each of the edges."""
        clipped = np.zeros(len(of), bool) if clipped is None else clipped
        bounds = [0, *(range(500, len(of), 500) if edges is None else edges), len(of)]
        for a, b in itertools.pairwise(bounds):
            force = of.accel[a:b] if accel else None
            celsius = of.temperature_c[a:b] if temperature else None
            windows = self.stillness.feed(of.time[a:b], of.gyro[a:b], force, clipped[a:b], celsius)
            for now, receipts in learnt(self.tracker, windows):
                self.receipts += receipts
                self.time.append(now)
                self.bias.append(self.tracker.bias)
                self.std.append(self.tracker.std)
        return self

    def at(self, time: Floats) -> Floats:
        """(n, 3) the bias as it was known at times (n,)."""
        known = np.searchsorted(self.time, time, side="left") - 1
        return np.array(self.bias)[np.maximum(known, 0)]

    def error_dps(self, of: Stream) -> Floats:
        """(3,) how far the bias is off, °/s, at the end of the stream."""
        return np.asarray(np.degrees(self.tracker.bias - of.bias[-1]))
