"""What bias trackers are tried on, and how they are judged: BROAD as recorded and as made harder, days on a ward, slow turns."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.sim.body import Activity
from bridge.sim.day import Day, simulate_day
from bridge.sim.quaternion import up_in_body
from bridge.sim.scenes import slow_turn
from tests.bench import broad
from tests.bench.optical import drift_deg_per_min, matrix_of
from tests.bench.trackers import Floats, Track

TURN_RATES_DPS = (0.1, 0.3, 1.0, 2.0)
_TURN_SEEDS = 4
_DAY_RATE_HZ = 52.0
#: a day is judged from the end of its first rest on, a minute on the table
_FIRST_REST_S = 60.0


ERROR = "Bias error, °/s rms per axis"
COVERED = "Share of a day's true bias within ±1.96 σ, %"
KEPT = "Share of a minute's slow turn kept, %"
DRIFT = "Heading drift in BROAD, °/min, median"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: what is measured in which group, the goal in real time and with the whole recording in hand."""

    name: str
    label: str
    group: str
    goal: float
    goal_smoothed: float

    @property
    def unit(self) -> str:
        """Of its values."""
        return {ERROR: "°/s", DRIFT: "°/min"}.get(self.group, "%")

    @property
    def median(self) -> bool:
        """Of its cases, where the others take the mean."""
        return self.group == DRIFT

    def summary(self, values: list[float]) -> float:
        """Of all its cases."""
        return float(np.median(values) if self.median else np.mean(values))


ROWS = (
    Row("BROAD as recorded", "BROAD: as recorded", ERROR, 0.005, 0.003),
    Row("BROAD no rest before", "BROAD: no rest before", ERROR, 0.1, 0.01),
    Row("BROAD ramp 0.05 °/s/min", "BROAD: ramp", ERROR, 0.04, 0.004),
    Row("BROAD bias of 3 °/s", "BROAD: bias of 3 °/s", ERROR, 0.005, 0.003),
    Row("BROAD with 3×3 as recorded", "3×3: as recorded", ERROR, 0.004, 0.002),
    Row("BROAD with 3×3 no rest before", "3×3: no rest before", ERROR, 0.05, 0.0035),
    Row("BROAD with 3×3 ramp 0.05 °/s/min", "3×3: ramp", ERROR, 0.03, 0.0035),
    Row("BROAD with 3×3 bias of 3 °/s", "3×3: bias of 3 °/s", ERROR, 0.004, 0.002),
    Row("ward day, calibrated", "ward day, calibrated", ERROR, 0.01, 0.005),
    Row("ward day, as bought", "ward day, as bought", ERROR, 0.01, 0.005),
    Row("ward day, calibrated: in ±1.96 σ", "ward day, calibrated", COVERED, 95.0, 95.0),
    Row("ward day, as bought: in ±1.96 σ", "ward day, as bought", COVERED, 95.0, 95.0),
    *(
        Row(f"turn of {rate:g} °/s kept, {how}", f"{rate:g} °/s {how}", KEPT, 100.0, 100.0)
        for how in ("on a table", "breathing")
        for rate in TURN_RATES_DPS
    ),
    Row("BROAD heading drift", "as recorded", DRIFT, 5.0, 5.0),
    Row("BROAD with 3×3 heading drift", "with 3×3", DRIFT, 2.2, 2.2),
)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One recording, its true bias, and what a track of it is worth: values by the names of ROWS."""

    name: str
    rate_hz: float
    gyro: Floats
    accel: Floats
    temperature_c: Floats | None
    bias: Floats
    judge: Callable[[Track], dict[str, float]]
    activity: NDArray[np.int8] | None = None


def broad_cases() -> Iterator[Case]:
    """Each trial in each scenario; then through the matrix learnt on the other trials of its sensor."""
    everything = broad.trials()
    for name in broad.SCENARIOS:
        for trial in everything:
            yield _broad_case("BROAD", name, trial)
            if siblings := broad.siblings(trial, everything):
                yield _broad_case("BROAD with 3×3", name, trial.turned(matrix_of(siblings)))


def _broad_case(prefix: str, name: str, trial: broad.Trial) -> Case:
    changed = broad.scenario(name, trial)

    def judge(track: Track) -> dict[str, float]:
        worth = {f"{prefix} {name}": changed.rmse_dps(track.bias)}
        if name == broad.SCENARIOS[0]:
            worth[f"{prefix} heading drift"] = drift_deg_per_min(changed, track.bias)
        return worth

    return Case(trial.name, changed.rate_hz, changed.gyro, changed.accel, None, changed.bias, judge)


def day_cases(days: int, hours: float) -> Iterator[Case]:
    """Wearers' days, of a device read through a calibration and of one as bought."""
    for calibrated in (True, False):
        for seed in range(days):
            day = simulate_day(seed, hours, _DAY_RATE_HZ, calibrated=calibrated)
            yield _day_case(f"ward day, {'calibrated' if calibrated else 'as bought'}", f"seed {seed}", day)


def _day_case(row: str, name: str, day: Day) -> Case:
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
    return Case(name, day.rate_hz, gyro, accel, temperature_c, bias, judge, day.activity)


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
