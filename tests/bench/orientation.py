"""Orientation beside VQF and imufusion: BROAD trials, simulated days, a minute of a gyro alone. `make bench-orientation`.

Inclination: angle between the true and the estimated vertical. Total: with the heading error since the first rest. Inside:
share of samples within two standard deviations. Ratio: rms of error by standard deviation. On BROAD the moving phases count;
peers are as their authors give them, six axes.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace

import imufusion
import numpy as np
import vqf
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

from bridge.recording import Recording
from bridge.sim.imu_errors import ImuSpec
from bridge.wire.messages import Calibration, SampleBatch, Verdict
from estimator.calibration.result import PARAMETERS
from estimator.config.device_settings import knobs_of
from estimator.device.prior_knowledge import PriorKnowledge
from estimator.device.session import DeviceSession
from estimator.noise.device_model import load_model
from estimator.offline.recordings import correct
from tests.bench import broad
from tests.estimator.stream import handle
from tests.sim.day import Day, simulate_day, worn_spec

Floats = NDArray[np.float64]
#: relative, and rad/s: what three turns by hand leave
_SCALE_STD, _BIAS_STD = 5e-4, np.radians(0.02)


@dataclass(frozen=True, slots=True, eq=False)
class Attitudes:
    """Quaternions (n, 4) wxyz, sensor to earth, and standard deviations (n,) rad where a method gives them."""

    quat_wxyz: Floats
    tilt_std: Floats | None = None
    heading_std: Floats | None = None


@dataclass(frozen=True, slots=True)
class Score:
    """Errors in degrees; shares of samples inside two standard deviations, rms of error by deviation (NaN for no deviation)."""

    inclination: float
    total: float
    tilt_inside: float
    heading_inside: float
    tilt_ratio: float
    heading_ratio: float


#: of rad/s, m/s², Hz, °C, and the device's calibration: where none is read, or known, None
Method = Callable[[Floats, Floats | None, float, Floats | None, Calibration | None], Attitudes]


def vqf_real_time(gyro: Floats, accel: Floats | None, rate_hz: float, *_: object) -> Attitudes:
    """VQF as it comes."""
    return Attitudes(vqf.VQF(1 / rate_hz).updateBatch(gyro, accel)["quat6D"])


def vqf_offline(gyro: Floats, accel: Floats | None, rate_hz: float, *_: object) -> Attitudes:
    """VQF with the whole recording in hand."""
    return Attitudes(vqf.offlineVQF(gyro, accel, None, 1 / rate_hz)["quat6D"])


def fusion(gyro: Floats, accel: Floats | None, rate_hz: float, *_: object) -> Attitudes:
    """xio Fusion with its bias correction, without a magnetometer."""
    assert accel is not None
    ahrs, bias, found = imufusion.Ahrs(), imufusion.Bias(), np.empty((len(gyro), 4))
    ahrs.set_sample_period(1 / rate_hz)
    bias.set_settings(imufusion.BiasSettings(sample_rate=rate_hz))
    for i, (rate_dps, force) in enumerate(zip(np.degrees(gyro), accel / 9.80665, strict=True)):
        ahrs.update_no_magnetometer(np.asarray(bias.update(rate_dps)), force)
        found[i] = ahrs.get_quaternion()
    return Attitudes(found)


def ours(model: str, *, smooth: bool = False) -> Method:
    """This project's, as `truerate correct --model` gives it; without a temperature the device had been on before."""

    def method(
        gyro: Floats, accel: Floats | None, rate_hz: float, temperature_c: Floats | None, known: Calibration | None
    ) -> Attitudes:
        recording = replace(Recording.from_arrays(gyro, accel, rate_hz=rate_hz), temperature_c=temperature_c)
        c = correct(recording, known, knobs_of(load_model(model)), smooth=smooth, warmed_up=temperature_c is None)
        return Attitudes(c.quat_wxyz.astype(float), c.tilt_std.astype(float), c.heading_std.astype(float))

    return method


PEERS: dict[str, Method] = {"VQF": vqf_real_time, "VQF offline": vqf_offline, "imufusion": fusion}


def methods(model: str) -> dict[str, Method]:
    """All methods; ours with a device model."""
    return {**PEERS, "truerate": ours(model), "truerate smoothed": ours(model, smooth=True)}


def errors(quat_wxyz: Floats, truth: Floats, zero: slice) -> tuple[Floats, Floats]:
    """Inclination and heading error (n,) rad of attitudes (n, 4), NaN where either is unknown.

    The heading error is taken as zero at the samples `zero`.
    """
    seen = np.isfinite(truth).all(axis=1) & np.isfinite(quat_wxyz).all(axis=1)
    error = np.full((len(truth), 4), np.nan)
    true, estimated = (Rotation.from_quat(q[seen], scalar_first=True) for q in (truth, quat_wxyz))
    error[seen] = (estimated * true.inv()).as_quat(scalar_first=True)
    heading = np.full(len(truth), np.nan)
    heading[seen] = np.unwrap(2 * np.arctan2(error[seen, 3], error[seen, 0]), period=2 * np.pi)
    heading -= np.nanmedian(heading[zero])
    return 2 * np.arccos(np.clip(np.hypot(error[:, 0], error[:, 3]), 0, 1)), heading


def judged(found: Attitudes, truth: Floats, counted: NDArray[np.bool_], zero: slice) -> Score:
    """Compare with true attitudes (n, 4), NaN where unknown; the heading error is taken as zero at the samples `zero`."""
    inclination, heading = errors(found.quat_wxyz, truth, zero)
    at = np.isfinite(inclination) & counted
    off = np.array([inclination, heading])[:, at]
    std = [np.full(len(at), np.nan) if of is None else of for of in (found.tilt_std, found.heading_std)]
    ratio = np.abs(off) / np.array(std)[:, at]
    inside = np.where(np.isnan(ratio).any(axis=1), np.nan, (ratio < 2).mean(axis=1))
    rms = [np.degrees(np.sqrt(np.mean(square))) for square in (off[0] ** 2, (off**2).sum(axis=0))]
    return Score(*(float(value) for value in (*rms, *inside, *np.sqrt(np.mean(ratio**2, axis=1)))))


def on_broad(method: Method) -> Iterator[Score]:
    """A method on each BROAD trial that is there."""
    for trial in broad.trials():
        zero = slice(0, max(int(np.argmax(trial.moving)), int(trial.rate_hz)))
        found = method(trial.gyro, trial.accel, trial.rate_hz, None, None)
        yield judged(found, trial.attitude, trial.moving, zero)


def bought(model: str) -> ImuSpec:
    """A device as bought (scale ± 3 %, misalignment ± 1°), whose bias flickers as its model says."""
    instability_dps = float(np.degrees(load_model(model).bias_instability.max()))
    return replace(worn_spec(104.0, calibrated=False), bias_instability_dps=instability_dps)


def on_days(method: Method, model: str, days: int, hours: float) -> Iterator[Score]:
    """A method on simulated days of devices calibrated by three turns, from the second minute on.

    Peers get rates that are corrected by the calibration; truerate gets the readings and the calibration.
    """
    for seed in range(days):
        day = simulate_day(1000 + seed, hours, spec=bought(model))
        counted = np.arange(len(day.gyro)) >= round(60 * day.rate_hz)
        known = by_hand(day, np.random.default_rng(seed))
        gyro, accel = day.gyro.astype(float), day.accel.astype(float)
        if method in PEERS.values():
            gyro = np.ascontiguousarray((gyro - known.bias) @ known.matrix.T)
        found = method(gyro, accel, day.rate_hz, day.temperature_c.astype(float), known)
        yield judged(found, day.attitude.astype(float), counted, slice(0, 10))


def gyro_only_minute(seeds: range, model: str) -> tuple[float, float]:
    """Share of minutes after which a gyro's heading is inside two standard deviations, and the rms of error by deviation.

    Half an hour of each simulated day of a device as bought, calibrated by three turns: scale to 0.05 %,
    bias to 0.02 °/s. Each minute is judged from its own beginning, where the heading is set to zero.
    """
    off = list[float]()
    for seed in seeds:
        day = simulate_day(2000 + seed, 0.5, spec=bought(model))
        off += minutes(day, model, np.random.default_rng(seed))
    found = np.abs(off)
    return float(np.mean(found < 2.0)), float(np.sqrt(np.mean(found**2)))


def by_hand(day: Day, rng: np.random.Generator) -> Calibration:
    """A calibration as three turns make it: with the errors that its covariance tells."""
    scale = day.truth.k * (1 + _SCALE_STD * rng.normal(size=3))
    return Calibration(
        device="simulated",
        boot=1,
        id="by-hand",
        time_ns=0,
        method="closure",
        verdict=Verdict.ACCEPTED,
        reason=(),
        matrix=np.diag(scale),
        bias=day.bias[0] + _BIAS_STD * rng.normal(size=3),
        parameters=PARAMETERS,
        covariance=np.diag([*np.full(3, _BIAS_STD**2), *(_SCALE_STD * scale) ** 2]),
        turns=(),
        noise_std=np.full(3, np.radians(0.11)),
        model="",
        firmware="",
        gyro_range=0.0,
        rate_hz=day.rate_hz,
        temperature_c=float(day.temperature_c[0]),
        who="",
    )


def minutes(day: Day, model: str, rng: np.random.Generator) -> list[float]:
    """Heading error by its standard deviation at the end of each minute, whose beginning is the zero."""
    gyro, rate_hz = day.gyro, day.rate_hz
    session, size, off = DeviceSession("simulated", knobs_of(load_model(model))), round(rate_hz), list[float]()
    session.orient()
    session.begin_boot(1, 0.0, PriorKnowledge(by_hand(day, rng), None))
    earth: Rotation | None = None
    true = Rotation.from_quat(day.attitude, scalar_first=True)
    for second, start in enumerate(range(0, len(gyro) - size + 1, size)):
        part = slice(start, start + size)
        handle(
            session,
            SampleBatch(
                device="simulated",
                boot=1,
                sequence=start,
                receive_time_ns=0,
                start_time_ns=0,
                tick_period_s=1 / rate_hz,
                clock_rate=1.0,
                ticks=np.arange(1 + start, 1 + start + size, dtype=np.uint64),
                gyro=gyro[part],
                accel=None,
                temperature_c=day.temperature_c[part],
                flags=np.zeros(size, np.uint32),
            ),
        )
        attitude = session.attitude
        assert attitude is not None
        last = part.stop - 1
        if second % 60 == 0 and second >= 60:
            if earth is not None:
                # The estimate's own start frame is turned into the true earth at the zero.
                error = (earth * attitude.rotation * true[last].inv()).as_rotvec()
                covariance = earth.as_matrix() @ attitude.cov @ earth.as_matrix().T
                off.append(float(error[2] / np.sqrt(covariance[2, 2])))
            session.orient()
            earth = None
        elif earth is None and second > 60 and attitude.begun:
            earth = true[last] * attitude.rotation.inv()
    return off


def shown(title: str, scores: dict[str, list[Score]]) -> Table:
    """A row for each method: medians, mean shares, and rms of error by deviation."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for name in ("", "inclination °", "mean", "total °", "tilt inside", "ratio", "heading inside", "ratio"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    for name, of in scores.items():
        inclination, total, tilt, heading, *ratios = np.array([astuple(score) for score in of]).T
        tilt_ratio, heading_ratio = (f"{np.sqrt(np.mean(ratio**2)):.2f}" for ratio in ratios)
        cells = f"{np.median(inclination):.3f}", f"{np.mean(inclination):.3f}", f"{np.median(total):.2f}"
        table.add_row(name, *cells, f"{tilt.mean():.3f}", tilt_ratio, f"{heading.mean():.3f}", heading_ratio)
    return table


def main() -> int:
    """Print the tables; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--model", default="factory-calibrated", help="device model of BROAD's sensors")
    asked.add_argument("--days", type=int, default=6, help="simulated days; 0 for none")
    asked.add_argument("--hours", type=float, default=1.0, help="of each")
    wanted, console = asked.parse_args(), Console(width=110)
    if broad.FOLDER.is_dir():
        console.print(shown("BROAD", {name: list(on_broad(m)) for name, m in methods(wanted.model).items()}))
    else:
        console.print(f"BROAD is not there ({broad.FOLDER}): left out", style="yellow")
    if wanted.days:
        of = {
            name: list(on_days(m, "icm-20948", wanted.days, wanted.hours)) for name, m in methods("icm-20948").items()
        }
        console.print(shown("simulated days, calibrated by hand", of))
        inside, rms = gyro_only_minute(range(wanted.days), "icm-20948")
        console.print(
            f"gyro alone, one minute: heading inside two deviations {inside:.3f}, rms of error by deviation {rms:.2f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
