"""Who tracks a bias: peers as their authors give them, one naive method, and ours, all behind one function.

A tracker takes gyro (n, 3) rad/s, accel (n, 3) m/s² or None, temperature (n,) °C or None and the rate in Hz, and gives the
bias (n, 3) rad/s it believes at each sample: the reading at zero rate. prior: what a calibration knew.
"""

from dataclasses import dataclass
from typing import Protocol

import imufusion
import numpy as np
import vqf
from numpy.typing import NDArray

from estimator.geometry.gyro_model import GyroModel
from estimator.stillness.detector import Stillness
from estimator.tracking.bias_state import BiasKnobs
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.tracker import Tracker as OurTracker
from tests.estimator.tracking.worn import learnt

Floats = NDArray[np.float64]

_BLOCK = 20_000
_STILL_S, _STILL_DPS, _STILL_ACCEL = 2.0, 1.0, 0.15


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of a gyro beforehand: bias_std rad/s of its bias, taken as zero; scale_std, relative, of its matrix.

    By default as of one calibrated by its maker. Peers have no way to be told.
    """

    bias_std: float = np.radians(0.5)
    scale_std: float = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The bias (n, 3) rad/s at each sample, and its standard deviation (n, 3) where the method gives one."""

    bias: Floats
    std: Floats | None = None


class Tracker(Protocol):
    """A method."""

    def __call__(
        self,
        gyro: Floats,
        accel: Floats | None,
        temperature_c: Floats | None,
        rate_hz: float,
        prior: Prior | None = None,
    ) -> Track | None:
        """The bias at each sample; None where the method does not apply, or is not there yet."""


def vqf_real_time(
    gyro: Floats, accel: Floats | None, temperature_c: Floats | None, rate_hz: float, prior: Prior | None = None
) -> Track | None:
    """VQF as it comes."""
    if accel is None:
        return None
    tracker, biases, sigmas = vqf.VQF(1 / rate_hz), [], []
    for start in range(0, len(gyro), _BLOCK):  # its full state is a kilobyte a sample
        here = slice(start, start + _BLOCK)
        state = tracker.updateBatchFullState(np.ascontiguousarray(gyro[here]), np.ascontiguousarray(accel[here]))
        biases.append(state["bias"].copy())
        sigmas.append(state["biasSigma"].copy())
    return Track(np.concatenate(biases), np.repeat(np.concatenate(sigmas)[:, None], 3, axis=1))


def vqf_offline(
    gyro: Floats, accel: Floats | None, temperature_c: Floats | None, rate_hz: float, prior: Prior | None = None
) -> Track | None:
    """VQF with the whole recording in hand, as it comes; it takes no prior."""
    if accel is None:
        return None
    found = vqf.offlineVQF(np.ascontiguousarray(gyro), np.ascontiguousarray(accel), None, 1 / rate_hz)
    return Track(found["bias"], np.repeat(found["biasSigma"][:, None], 3, axis=1))


def fusion(
    gyro: Floats, accel: Floats | None, temperature_c: Floats | None, rate_hz: float, prior: Prior | None = None
) -> Track:
    """xio Fusion's bias correction as it comes; the gyro alone."""
    tracker, bias = imufusion.Bias(), np.empty_like(gyro)
    tracker.set_settings(imufusion.BiasSettings(sample_rate=rate_hz))
    for i, rate_dps in enumerate(np.degrees(gyro)):
        tracker.update(rate_dps)
        bias[i] = tracker.get_offset()
    return Track(np.radians(bias))


def first_still(
    gyro: Floats, accel: Floats | None, temperature_c: Floats | None, rate_hz: float, prior: Prior | None = None
) -> Track:
    """The mean of the first window of two still seconds, for ever; before it, the prior, or zero."""
    bias = np.zeros_like(gyro)
    n = round(_STILL_S * rate_hz)
    for start in range(0, len(gyro) - n, n):
        window = slice(start, start + n)
        quiet = np.degrees(gyro[window].std(axis=0)).max() < _STILL_DPS
        if quiet and (accel is None or accel[window].std(axis=0).max() < _STILL_ACCEL):
            bias[start + n :] = gyro[window].mean(axis=0)
            break
    return Track(bias)


def ours(
    gyro: Floats,
    accel: Floats | None,
    temperature_c: Floats | None,
    rate_hz: float,
    prior: Prior | None = None,
    *,
    smoothed: bool = False,
) -> Track | None:
    """This project's tracker, in real time or smoothed: the one place where the bench meets it."""
    n = len(gyro)
    time = np.arange(1, n + 1) / rate_hz
    prior = prior or Prior()
    bias, std = np.zeros(3), np.full(3, prior.bias_std)
    scale_std = np.full(3, prior.scale_std)
    model = GyroModel(np.eye(3), bias, scale_std, scale_std, np.full(3, 2e-3))
    knobs = TrackKnobs(history=None, bias=BiasKnobs(warm_up_walk=0.0))  # nobody knows when these were powered up
    tracker, stillness = OurTracker(knobs, 0.0, model, std), Stillness()
    found, stds, steps = [bias], [std], [0.0]
    for start in range(0, n, _BLOCK):
        here = slice(start, start + _BLOCK)
        force = None if accel is None else accel[here]
        celsius = None if temperature_c is None else temperature_c[here]
        for now, _ in learnt(tracker, stillness.feed(time[here], gyro[here], force, celsius=celsius)):
            if now - steps[-1] > 0.5:
                found.append(tracker.bias)
                stds.append(tracker.std)
                steps.append(now)
    if smoothed:
        whole = tracker.smoothed()
        if whole is None:
            return None
        return Track(
            *(
                np.column_stack([np.interp(time, whole.time, of[:, i]) for i in range(3)])
                for of in (whole.bias, whole.std)
            )
        )
    # A sample is corrected by what was known before it.
    known = np.searchsorted(steps, time, side="left") - 1
    return Track(np.array(found)[known], np.array(stds)[known])


def ours_smoothed(
    gyro: Floats, accel: Floats | None, temperature_c: Floats | None, rate_hz: float, prior: Prior | None = None
) -> Track | None:
    """This project's tracker with the whole recording in hand."""
    return ours(gyro, accel, temperature_c, rate_hz, prior, smoothed=True)


TRACKERS: dict[str, Tracker] = {
    "VQF": vqf_real_time,
    "VQF offline": vqf_offline,
    "imufusion": fusion,
    "first still": first_still,
    "truerate": ours,
    "truerate smoothed": ours_smoothed,
}
