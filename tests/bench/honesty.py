"""Is the tracker as sure of the bias as it may be? NEES per degree of freedom in scenes a filter's own model holds in.

White noise, a bias that is a random walk of the strength the tracker is told, true rests and free movement between them; it
begins with an honest deviation. At the end of a scene, and on the way: the mean over every second of it. The band is that
of so many independent seeds; on the way each seed counts as one, though its seconds make it scatter less. What is outside is
marked with "!", and looked at again with four times as many other seeds: of 44 values one or two are outside by chance.
(*): more than the filter's model holds. `make bench-tracking`.
"""

import argparse
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import chi2

from bridge.sim.imu_errors import ImuSpec
from estimator.config.device_settings import FLICKER
from estimator.geometry.gyro_model import GyroModel, PriorKnobs, uncalibrated
from estimator.stillness.detector import Stillness
from estimator.tracking.bias_state import BiasKnobs
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.tracker import Tracker
from tests.estimator.tracking.worn import learnt
from tests.sim.day import Day, simulate_day, worn_spec
from tests.sim.scenes import rests_and_motion, steady_walk, turned_by_hand, walk_with_pauses

_RATE_HZ = 50.0
_BEGIN_STD = np.radians(0.02)
#: relative, of the matrix, which the tracker is told
_MATRIX_STD = 1e-3


@dataclass(frozen=True, slots=True)
class Scene:
    """What rests_and_motion is asked for: s, °/s per root s, °/s, and the lengths of rests and movements, s, between two."""

    seconds: float = 120.0
    walk_dps: float = 2e-3
    noise_dps: float = 0.05
    rest_s: tuple[float, float] = (3.0, 20.0)
    motion_s: tuple[float, float] = (5.0, 60.0)
    #: K, of a step of temperature every 200 s, which the tracker is told; 0 where it is told none
    step_k: float = 0.0
    #: °/s, bias instability B of another day, which the tracker is told
    unstable_dps: float = 0.0
    #: another day in place of that, of a seed, at a rate; its temperature is told
    other: Callable[[int, float], Day] | None = None
    #: whether the tracker is told the matrix, and the bias as the scene begins; else as little as of any new device
    calibrated: bool = True

    def day(self, seed: int) -> Day:
        """Of a seed."""
        if self.other is not None:
            return self.other(seed, _RATE_HZ)
        return rests_and_motion(
            seed,
            self.seconds,
            _RATE_HZ,
            rrw_dps_per_sqrt_s=self.walk_dps,
            noise_dps=self.noise_dps,
            rest_s=self.rest_s,
            motion_s=self.motion_s,
            bias_dps_per_kelvin=_PER_KELVIN_DPS if self.step_k else 0.0,
            step_k=self.step_k,
        )


#: °/s per kelvin, ±: of a deviation as the filter believes of any part
_PER_KELVIN_DPS = float(np.degrees(BiasKnobs().per_kelvin) * np.sqrt(3))
#: a device of such parts, and one of which nobody knows more than this
_WORN, _PRIOR = replace(worn_spec(_RATE_HZ), bias_dps_per_kelvin=_PER_KELVIN_DPS), PriorKnobs()
_NEW = replace(
    _WORN,
    scale=(1 - float(np.sqrt(3)) * _PRIOR.scale_std, 1 + float(np.sqrt(3)) * _PRIOR.scale_std),
    misalignment_deg=float(np.degrees(_PRIOR.misalignment_std) * np.sqrt(3)),
    bias_limit_dps=float(np.degrees(_PRIOR.bias_std) * np.sqrt(3)),
    warm_up_s=60.0,
)


def _on_the_ward(seed: int, rate_hz: float, spec: ImuSpec) -> Day:
    """A quarter of an hour of it; what is read at zero rate has what gravity does to the gyro in it."""
    day = simulate_day(seed, 0.25, rate_hz, spec)
    by_gravity = day.accel.astype(float) @ day.truth.g_sensitivity.T
    return replace(day, bias=(day.bias + by_gravity).astype(np.float32))


SCENES: Mapping[str, Scene] = {
    "rests and movement": Scene(),
    "the same, five minutes": Scene(seconds=300.0),
    "short rests, seldom": Scene(seconds=240.0, rest_s=(4.0, 8.0), motion_s=(20.0, 60.0)),
    "long rests": Scene(seconds=240.0, rest_s=(30.0, 60.0), motion_s=(5.0, 20.0)),
    "short of both": Scene(rest_s=(3.0, 8.0), motion_s=(2.0, 6.0)),
    "twice the noise": Scene(noise_dps=0.1),
    "less than half of it": Scene(noise_dps=0.02),
    "a slower walk": Scene(walk_dps=8e-4),
    "temperature steps": Scene(seconds=590.0, step_k=0.5),
    # Outside the model: a leap of over 2 K is not believed for ten seconds, while the bias has followed it at once.
    "temperature leaps (*)": Scene(seconds=590.0, step_k=2.0),
    "a steady walk": Scene(walk_dps=7e-4, other=partial(steady_walk, spec=_WORN)),
    # Its rests are so short that they are believed less than they deserve: below the band.
    "turned by hand, uncalibrated (*)": Scene(
        walk_dps=7e-4, other=partial(turned_by_hand, spec=_NEW), calibrated=False
    ),
    # Outside: a bias that flickers, as the best and the worst of the class do (configs/devices), and one that gravity moves.
    **{
        f"on the ward, {what}": Scene(
            walk_dps=7e-4, unstable_dps=spec.bias_instability_dps, other=partial(_on_the_ward, spec=spec)
        )
        for what, spec in {
            "nothing of that (*)": _WORN,  # who wears it breathes
            "B 0.004 °/s (*)": replace(_WORN, bias_instability_dps=0.004),
            "B 0.014 °/s (*)": replace(_WORN, bias_instability_dps=0.014),
            "G 0.02 °/s/g (*)": replace(_WORN, g_sensitivity_dps_per_g=0.02),
            "G 0.1 °/s/g (*)": replace(_WORN, g_sensitivity_dps_per_g=0.1),
        }.items()
    },
    # Outside, too: what seems a rest is none, while the skin warms the device by what the tracker does not know yet.
    "a walk with pauses (*)": Scene(walk_dps=7e-4, other=partial(walk_with_pauses, spec=_WORN)),
}


class Score(NamedTuple):
    """Of a seed, or of many on the mean: NEES/dof at the end and on the way, mean squared error, (rad/s)².

    within: of the truth, how much lies within ±1.96 of the deviations that are told, on the way.
    """

    end: float
    way: float
    squared: float
    within: float


def band(seeds: int) -> tuple[float, float]:
    """Where the mean NEES/dof of an honest filter lies in 95 % of cases."""
    low, high = chi2.ppf([0.025, 0.975], 3 * seeds) / (3 * seeds)
    return float(low), float(high)


def measured(scene: Scene, seeds: range, *, accel: bool, told: float = 1.0, pool: Executor | None = None) -> Score:
    """Of these seeds, on the mean; told: how much of the walk the tracker is told of."""
    lived = partial(_lived, scene, accel=accel, told=told)
    scores = map(lived, seeds) if pool is None else pool.map(lived, seeds, chunksize=5)
    return Score(*np.mean(list(scores), axis=0).tolist())


def _lived(scene: Scene, seed: int, *, accel: bool, told: float) -> Score:
    day = scene.day(seed)
    known, std = np.full(3, _MATRIX_STD), _BEGIN_STD if scene.calibrated else _PRIOR.bias_std
    begin = day.bias[0] + std * np.random.default_rng(seed).normal(size=3)
    model = GyroModel(day.truth.matrix, begin, known, known, known) if scene.calibrated else uncalibrated(_PRIOR)
    walk, flicker = np.radians([told * scene.walk_dps, FLICKER * scene.unstable_dps]).tolist()
    knobs = TrackKnobs(bias=BiasKnobs(rate_random_walk=walk, warm_up_walk=0.0, flicker=flicker))
    tracker = Tracker(knobs, 0.0, model, np.full(3, std))
    last, force = 0.0, day.accel.astype(float) if accel else None
    nees, squared, within = [], [], []
    celsius = day.temperature_c if scene.step_k or scene.other else None
    for _ in learnt(tracker, Stillness().feed(day.time_s, day.gyro.astype(float), force, celsius=celsius)):
        if tracker.time == last:
            continue
        last = tracker.time
        error = tracker.bias - day.bias[round(last * _RATE_HZ) - 1]
        nees.append(float(error @ np.linalg.solve(tracker.state.bias_cov + flicker**2 * np.eye(3), error)) / 3)
        squared.append(float(error @ error) / 3)
        within.append(np.abs(error) < 1.96 * np.hypot(tracker.std, flicker))
    return Score(nees[-1], float(np.mean(nees)), float(np.mean(squared)), float(np.mean(within)))


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seeds", type=int, default=200, help="of each scene")
    asked.add_argument("--first", type=int, default=0, help="seed to begin with")
    wanted, _ = asked.parse_known_args()  # --hours and --days are for those beside it
    console = Console()
    console.width = max(console.width, 100)
    low, high = band(wanted.seeds)
    table = Table(
        title=f"NEES/dof over {wanted.seeds} seeds; 95 % band {low:.3f} to {high:.3f}",
        title_justify="left",
        box=None,
        pad_edge=False,
    )
    for heading in ("", "", "at the end", "on the way", "error, °/s rms", "in ±1.96 σ, %"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)

    def looked_at(name: str, seeds: range, *, accel: bool) -> bool:
        """Whether it is inside."""
        score = measured(SCENES[name], seeds, accel=accel, pool=pool)
        inside = [low < one < high for one in score[:2]]
        marked = [f"{one:.3f}{' ' if fit else '!'}" for one, fit in zip(score[:2], inside, strict=True)]
        rms = float(np.degrees(np.sqrt(score.squared)))
        again = seeds.start > wanted.first
        what = f"{len(seeds)} other seeds" if again else "accelerometer-aided" if accel else "gyro only"
        table.add_row(name if accel and not again else "", what, *marked, f"{rms:.4f}", f"{100 * score.within:.1f}")
        return all(inside)

    first, then = wanted.first, wanted.first + wanted.seeds
    both = [(name, accel) for name in SCENES for accel in (True, False)]
    with ProcessPoolExecutor() as pool:
        for name, accel in track(both, "honesty", console=console):
            if not looked_at(name, range(first, then), accel=accel):
                looked_at(name, range(then, then + 4 * wanted.seeds), accel=accel)
    console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
