"""What bias trackers are tried on, and how they are judged: BROAD as recorded and as made harder, days on a ward, slow turns."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.sim.body import Activity
from bridge.sim.quaternion import up_in_body
from tests.bench import broad
from tests.bench.optical import matrix_of
from tests.bench.trackers import Floats, Prior, Track
from tests.sim.day import Day, simulate_day
from tests.sim.scenes import slow_turn

TURN_RATES_DPS = (0.1, 0.3, 1.0, 2.0)
_TURN_SEEDS = 40
_DAY_RATE_HZ = 52.0
#: a day is judged from the end of its first rest on, a minute on the table
_FIRST_REST_S = 60.0


ERROR = "Bias error, °/s rms per axis"
COVERED = "Share of a day's true bias within ±1.96 σ, %"
KEPT = "Share of a minute's slow turn kept, %"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: what is measured in which group, the goal in real time and with the whole recording in hand."""

    name: str
    label: str
    group: str
    goal: float
    goal_smoothed: float

    def furthest(self, values: list[float]) -> float | None:
        """The case furthest off, where cases err to both sides and their mean hides it."""
        return max(values, key=lambda value: abs(value - 100), default=None) if self.group == KEPT else None


NONE = float("nan")
#: the goals of the project; NaN where it has none
ROWS = (
    Row("BROAD as recorded", "BROAD: as recorded", ERROR, 0.003, 0.002),
    Row("BROAD no rest before", "BROAD: no rest before", ERROR, 0.1, 0.008),
    Row("BROAD ramp 0.05 °/s/min", "BROAD: ramp", ERROR, 0.03, 0.004),
    Row("BROAD bias of 3 °/s", "BROAD: bias of 3 °/s", ERROR, 0.005, NONE),
    Row("BROAD with 3×3 as recorded", "3×3: as recorded", ERROR, NONE, NONE),
    Row("BROAD with 3×3 no rest before", "3×3: no rest before", ERROR, 0.06, NONE),
    Row("BROAD with 3×3 ramp 0.05 °/s/min", "3×3: ramp", ERROR, 0.02, NONE),
    Row("BROAD with 3×3 bias of 3 °/s", "3×3: bias of 3 °/s", ERROR, NONE, NONE),
    Row("ward day, calibrated", "ward day, calibrated", ERROR, 0.01, NONE),
    Row("ward day, gyro only", "ward day, gyro only", ERROR, 0.02, NONE),
    Row("ward day, as bought", "ward day, as bought", ERROR, NONE, NONE),
    Row("ward day, calibrated: in ±1.96 σ", "ward day, calibrated", COVERED, 95.0, NONE),
    Row("ward day, gyro only: in ±1.96 σ", "ward day, gyro only", COVERED, 95.0, NONE),
    Row("ward day, as bought: in ±1.96 σ", "ward day, as bought", COVERED, 95.0, NONE),
    *(
        Row(f"turn of {rate:g} °/s kept, {how}", f"{rate:g} °/s {how}", KEPT, 99.0, NONE)
        for how in ("on a table", "breathing")
        for rate in TURN_RATES_DPS
    ),
)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One recording, its true bias, and what a track of it is worth: values by the names of ROWS."""

    name: str
    rate_hz: float
    gyro: Floats
    accel: Floats | None
    temperature_c: Floats | None
    bias: Floats
    judge: Callable[[Track], dict[str, float]]
    activity: NDArray[np.int8] | None = None
    prior: Prior | None = None


#: what the 3×3 of another trial, and a calibration by hand, leave of scale and misalignment, relative
_BY_OTHER_TRIAL, _BY_HAND = 1e-3, 2e-3


def broad_cases() -> Iterator[Case]:
    """Each trial in each scenario; then through the matrix learnt on the other trials of its sensor."""
    everything = broad.trials()
    for name in broad.SCENARIOS:
        for trial in everything:
            yield _broad_case("BROAD", name, trial)
            if siblings := broad.siblings(trial, everything):
                prior = Prior(scale_std=_BY_OTHER_TRIAL)
                yield _broad_case("BROAD with 3×3", name, trial.turned(matrix_of(siblings)), prior)


def _broad_case(prefix: str, name: str, trial: broad.Trial, prior: Prior | None = None) -> Case:
    changed = broad.scenario(name, trial)

    def judge(track: Track) -> dict[str, float]:
        return {f"{prefix} {name}": changed.rmse_dps(track.bias)}

    return Case(trial.name, changed.rate_hz, changed.gyro, changed.accel, None, changed.bias, judge, prior=prior)


def day_cases(days: int, hours: float) -> Iterator[Case]:
    """Wearers' days, of a device read through a calibration, the same without accelerometer, and of one as bought."""
    for seed in range(days):
        day = simulate_day(seed, hours, _DAY_RATE_HZ)
        yield _day_case("ward day, calibrated", f"seed {seed}", day, Prior(scale_std=_BY_HAND))
        yield _day_case("ward day, gyro only", f"seed {seed}", day, Prior(scale_std=_BY_HAND), aided=False)
        as_bought = simulate_day(seed, hours, _DAY_RATE_HZ, calibrated=False)
        yield _day_case(
            "ward day, as bought", f"seed {seed}", as_bought, Prior(bias_std=np.radians(5.0), scale_std=0.03)
        )


def _day_case(row: str, name: str, day: Day, prior: Prior, *, aided: bool = True) -> Case:
    judged = day.time_s > _FIRST_REST_S

    def judge(track: Track) -> dict[str, float]:
        error = (track.bias - day.bias)[judged]
        worth = {row: float(np.degrees(np.sqrt(np.mean(error**2))))}
        if track.std is not None:
            worth[f"{row}: in ±1.96 σ"] = 100 * float(np.mean(np.abs(error) < 1.96 * track.std[judged]))
        return worth

    gyro, accel, temperature_c, bias = (
        one.astype(np.float64) for one in (day.gyro, day.accel, day.temperature_c, day.bias)
    )
    force = accel if aided else None
    return Case(name, day.rate_hz, gyro, force, temperature_c, bias, judge, day.activity, prior)


def turn_cases() -> Iterator[Case]:
    """A minute's slow turn between two minutes of rest."""
    for how, breath in (("on a table", 0.0), ("breathing", 1.0)):
        for rate_dps in TURN_RATES_DPS:
            for seed in range(_TURN_SEEDS):
                day = slow_turn(rate_dps * (-1) ** seed, breath=breath, seed=seed)
                yield _turn_case(f"turn of {rate_dps:g} °/s kept, {how}", f"seed {seed}", day)


def _turn_case(row: str, name: str, day: Day) -> Case:
    turning = day.activity == Activity.SLOW_TURN
    up = up_in_body(day.attitude.astype(np.float64))[turning]
    gyro, accel, temperature_c, bias = (
        one.astype(np.float64) for one in (day.gyro, day.accel, day.temperature_c, day.bias)
    )

    def judge(track: Track) -> dict[str, float]:
        seen = np.sum((gyro - track.bias)[turning] * up)
        return {row: 100 * float(seen / np.sum(day.rate[turning] * up))}

    return Case(name, day.rate_hz, gyro, accel, temperature_c, bias, judge, day.activity)
