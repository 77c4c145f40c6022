"""Comparison of the estimator's results for each boot with the simulator's truth, for the demonstration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.sim.virtual_device import VirtualDevice
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch, Status
from estimator.geometry import rotation

Floats = NDArray[np.float64]
MIN_SAMPLES = 200
#: least and largest permitted error of scale factor (relative) and bias, °/s; between them SIGMAS standard deviations
SCALE, BIAS_DPS, SIGMAS = (0.01, 0.02), (0.05, 0.2), 4.0
#: permitted heading error: degrees, or a share of the largest raw one
HEADING_DEG, HEADING_SHARE = 5.0, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """Errors of one boot of one device, for the n samples from the first of quality GOOD to the last of this quality.

    k_true, k, k_std (3,): true and estimated scale factors at the last sample, and standard deviation of the estimate,
    without unit.
    time (n,): device time, s. bias_true_dps, bias_dps, bias_std_dps (n, 3): true and estimated bias, and its standard
    deviation, sensor frame.
    raw_heading_deg, corrected_heading_deg (n,): heading error of the integrated readings and corrected rates.
    """

    device: str
    boot: int
    k_true: Floats
    k: Floats
    k_std: Floats
    time: Floats
    bias_true_dps: Floats
    bias_dps: Floats
    bias_std_dps: Floats
    raw_heading_deg: Floats
    corrected_heading_deg: Floats

    @property
    def good(self) -> bool:
        """True if scale factors and final bias are within their limits, and the corrected heading error is small.

        Limits of scale and bias errors: SIGMAS standard deviations, clipped to the ranges SCALE (without unit) and
        BIAS_DPS. Limit of the heading error: HEADING_DEG, or HEADING_SHARE of the largest raw error if that is more.
        """
        left, raw = np.abs(self.corrected_heading_deg).max(), np.abs(self.raw_heading_deg).max()
        return bool(
            np.all(np.abs(self.k - self.k_true) < np.clip(SIGMAS * self.k_std, *SCALE))
            and np.all(np.abs(self.bias_off_dps) < np.clip(SIGMAS * self.bias_std_dps[-1], *BIAS_DPS))
            and left < max(HEADING_DEG, HEADING_SHARE * raw)
        )

    @property
    def bias_off_dps(self) -> Floats:
        """Error (3,) of the estimated bias at the end, °/s: estimate minus truth."""
        return np.asarray(self.bias_dps[-1] - self.bias_true_dps[-1])


def judge(
    device: VirtualDevice, boot: int, corrected: list[CorrectedBatch], raw: list[SampleBatch], status: Status
) -> Judgement | None:
    """Compare a boot's corrected and raw samples with the truth; None if fewer than MIN_SAMPLES have quality GOOD.

    status: last status of the boot, which has the estimated scale factors. Raises LookupError if samples are missing.
    """
    good = [batch for batch in corrected if batch.quality is Quality.GOOD]
    if sum(map(len, good)) < MIN_SAMPLES:
        return None
    first, last = good[0].sequence, good[-1].sequence + len(good[-1]) - 1
    rate = _run(first, last, [(b.sequence, b.rate.astype(float)) for b in corrected])
    reading = _run(first, last, [(b.sequence, b.gyro.astype(float)) for b in raw])
    time = _run(first, last, [(b.sequence, b.device_time[:, None]) for b in corrected])[:, 0]
    bias = _run(first, last, [(b.sequence, np.tile(b.bias.astype(float), (len(b), 1))) for b in corrected])
    scale = np.array(status.scale)
    bias_std = _run(first, last, [(b.sequence, np.tile(b.bias_std / scale, (len(b), 1))) for b in corrected])
    truth = device.truth.between(boot, first, last)
    start = Rotation.from_quat(truth.attitude[0], scalar_first=True)
    true = Rotation.from_quat(truth.attitude, scalar_first=True)
    return Judgement(
        device=device.name,
        boot=boot,
        k_true=device.truth.sensor(boot).k,
        k=scale,
        k_std=good[-1].scale_std * scale,
        time=time,
        bias_true_dps=np.degrees(truth.bias),
        bias_dps=np.degrees(bias),
        bias_std_dps=np.degrees(bias_std),
        raw_heading_deg=_heading_error(reading, time, start, true),
        corrected_heading_deg=_heading_error(rate, time, start, true),
    )


def _run(first: int, last: int, parts: list[tuple[int, Floats]]) -> Floats:
    """Rows of samples first to last, from parts with their sequence numbers. Raises LookupError when one is missing."""
    rows = np.concatenate([values for _, values in parts])
    numbers = np.concatenate([np.arange(begin, begin + len(values)) for begin, values in parts])
    wanted = (numbers >= first) & (numbers <= last)
    if wanted.sum() != last - first + 1:
        raise LookupError(f"{wanted.sum()} of the {last - first + 1} samples after its calibration arrived")
    return rows[wanted]


def _heading_error(rate: Floats, time: Floats, start: Rotation, true: Rotation) -> Floats:
    """(n,) heading error in degrees, unwrapped: attitude integrated from the first sample against the true one."""
    dt = rotation.intervals(time)
    estimate = start * Rotation.from_matrix(rotation.attitudes(rate[1:], dt[1:]))
    error = (estimate * true.inv()).as_matrix()
    return np.array(np.degrees(np.unwrap(np.arctan2(error[:, 1, 0], error[:, 0, 0]))))


def in_words(judgement: Judgement) -> str:
    """Return one line for people: heading error raw and corrected, in degrees, and largest scale and bias errors."""
    raw, corrected = (
        heading[np.argmax(np.abs(heading))] for heading in (judgement.raw_heading_deg, judgement.corrected_heading_deg)
    )
    scale, bias = (float(np.max(np.abs(off))) for off in (judgement.k - judgement.k_true, judgement.bias_off_dps))
    return (
        f"heading off by up to {raw:+.0f}° raw, {corrected:+.2f}° corrected; "
        f"scale within {scale:.2%}, bias within {bias:.3f} °/s"
    )
