"""At rest: how often is the truth within ±1.96 σ of the bias that is believed just then? `make bench-tracking`.

BROAD's rests are real: what is believed is held against the mean of what the gyro reads in the ten seconds that follow, which the
tracker has not seen; that mean's own noise (the scatter of the trial's resting seconds) and the walk of the bias meanwhile count,
too. "as it begins": by what was known before the rest; "in it": every second from two seconds after its begin on. Of simulated
days the truth is known; who wears the device breathes. The goal is 93 to 97 %. Seconds of one rest err alike, so the range is
that of rests drawn anew. Writes out/rests.json.
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bridge.sim.body import Activity
from estimator.tracking.bias_filter import BiasKnobs
from tests.bench import broad
from tests.bench.optical import matrix_of
from tests.bench.trackers import Floats, Prior, Track, ours
from tests.sim.day import Day, simulate_day

#: seconds that a real bias is held against: most, and least
_AHEAD_S, _LEAST_S = 10.0, 4.0
#: known from then on, s: a second and more of the rest has told
_TOLD_S = 2.0
_SIGMAS, _DRAWS = 1.96, 2000
#: what a simulated device rests in
_QUIET = {
    "on a table": (Activity.TABLE,),
    "lying, asleep": (Activity.LYING, Activity.ASLEEP),
    "sitting": (Activity.SITTING,),
}
#: what the 3×3 of another trial, and a calibration by hand, leave of scale and misalignment, relative
_BY_OTHER_TRIAL, _BY_HAND = 1e-3, 2e-3
_DAY_RATE_HZ = 52.0


@dataclass(slots=True)
class Held:
    """Normalised errors (k, 3) of the bias in each of some rests."""

    rests: list[Floats] = field(default_factory=list)

    @property
    def share(self) -> float:
        """Within ±1.96, %."""
        return _share(self._counts().sum(axis=0))

    @property
    def squared(self) -> float:
        """Mean square; 1 when honest."""
        return float(np.mean(np.concatenate(self.rests) ** 2))

    def range(self) -> tuple[float, float]:
        """Of the share, 95 %, if other rests of the kind had been met."""
        counts, rng = self._counts(), np.random.default_rng(0)
        drawn = [_share(counts[rng.integers(len(counts), size=len(counts))].sum(axis=0)) for _ in range(_DRAWS)]
        low, high = np.quantile(drawn, [0.025, 0.975])
        return float(low), float(high)

    def _counts(self) -> NDArray[np.int_]:
        return np.array([(int(np.sum(np.abs(z) < _SIGMAS)), z.size) for z in self.rests])


def _share(counts: NDArray[np.int_]) -> float:
    return 100 * float(counts[0] / counts[1])


def broad_rests() -> Iterator[tuple[str, Floats]]:
    """Row and normalised errors of each real rest."""
    everything = broad.trials()
    for trial in track(everything, "BROAD"):
        siblings = broad.siblings(trial, everything)
        tried = [("BROAD, aided", trial, trial.accel, Prior()), ("BROAD, gyro only", trial, None, Prior())]
        if siblings:
            turned = trial.turned(matrix_of(siblings))
            tried.append(("BROAD with 3×3, aided", turned, turned.accel, Prior(scale_std=_BY_OTHER_TRIAL)))
        for name, read, accel, prior in tried:
            found = ours(read.gyro, accel, None, read.rate_hz, prior)
            if found is not None and found.std is not None:
                yield from ((f"{name}: {when}", z) for when, z in held_against_what_follows(read, found))


def held_against_what_follows(trial: broad.Trial, found: Track) -> Iterator[tuple[str, Floats]]:
    """When, and normalised errors (k, 3), rest by rest."""
    rests, second = broad.rests(trial.moving, trial.rate_hz), round(trial.rate_hz)
    noise_var = _second_var([trial.gyro[rest] for rest in rests], second)
    for rest in rests:
        told = rest.start + round(_TOLD_S * trial.rate_hz)
        last = rest.stop - round(_LEAST_S * trial.rate_hz)
        if rest.start > second:
            yield "as it begins", np.array([_error(trial, found, rest.start - second // 2, rest, noise_var)])
        if told < last:
            yield "in it", np.array([_error(trial, found, at, rest, noise_var) for at in range(told, last, second)])


def _error(trial: broad.Trial, found: Track, at: int, rest: slice, noise_var: Floats) -> Floats:
    """(3,) of what is believed at a sample, which is none of those it is held against."""
    begin = max(at, rest.start)
    end = min(rest.stop, begin + round(_AHEAD_S * trial.rate_hz))
    seconds = (end - begin) / trial.rate_hz
    assert found.std is not None
    var = found.std[at] ** 2 + noise_var / seconds + BiasKnobs().rate_random_walk ** 2 * seconds / 3
    return np.asarray((found.bias[at] - trial.gyro[begin:end].mean(axis=0)) / np.sqrt(var))


def _second_var(rests: list[Floats], second: int) -> Floats:
    """(3,) variance of the mean of a second's readings (second, 3) within rests."""
    scatter, freedom = np.zeros(3), 0
    for gyro in rests:
        k = len(gyro) // second
        means = gyro[: k * second].reshape(k, second, 3).mean(axis=1)
        scatter += ((means - means.mean(axis=0)) ** 2).sum(axis=0)
        freedom += k - 1
    return np.asarray(scatter / freedom)


def day_rests(days: int, hours: float) -> Iterator[tuple[str, Floats]]:
    """Row and normalised errors of each simulated rest, once the bias has been told."""
    for seed in track(range(days), "ward days"):
        day = simulate_day(seed, hours, _DAY_RATE_HZ)
        gyro, accel, celsius, bias = (
            one.astype(np.float64) for one in (day.gyro, day.accel, day.temperature_c, day.bias)
        )
        for how, force in (("aided", accel), ("gyro only", None)):
            found = ours(gyro, force, celsius, day.rate_hz, Prior(scale_std=_BY_HAND))
            if found is not None and found.std is not None:
                z = (found.bias - bias) / found.std
                yield from ((f"ward day, {how}: {where}", one) for where, one in _by_rest(day, z))


def _by_rest(day: Day, z: Floats) -> Iterator[tuple[str, Floats]]:
    """Where, and z (k, 3) of every second of each rest."""
    second = round(day.rate_hz)
    for where, kinds in _QUIET.items():
        edges = np.flatnonzero(np.diff(np.isin(day.activity[::second], kinds), prepend=False, append=False))
        for begin, end in edges.reshape(-1, 2) + np.array([round(_TOLD_S), 0]):
            if begin < end:
                yield where, z[::second][begin:end]


def shown(held: dict[str, Held]) -> Table:
    """A line a row."""
    table = Table(title="Rests: the truth within ±1.96 σ", title_justify="left", box=None, pad_edge=False)
    for heading in ("", "rests", "seconds", "share, %", "range, %", "mean z²"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for name, one in held.items():
        low, high = one.range()
        seconds = sum(len(z) for z in one.rests)
        range_ = f"{low:.1f}–{high:.1f}"
        table.add_row(name, str(len(one.rests)), str(seconds), f"{one.share:.1f}", range_, f"{one.squared:.2f}")
    return table


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--hours", type=float, default=8.0, help="of each day")
    asked.add_argument("--days", type=int, default=3, help="of each kind; 0 for none")
    asked.add_argument("--out", type=Path, default=Path("out"))
    wanted = asked.parse_args()
    console = Console()
    console.width = max(console.width, 100)
    held: dict[str, Held] = defaultdict(Held)
    if not broad.FOLDER.is_dir():
        console.print(f"BROAD is not there ({broad.FOLDER}): left out", style="yellow")
    for rests in (broad_rests(), day_rests(wanted.days, wanted.hours)):
        for name, z in rests:
            held[name].rests.append(z)
    console.print(shown(held))
    wanted.out.mkdir(parents=True, exist_ok=True)
    found = {name: {"share": one.share, "range": one.range(), "z2": one.squared} for name, one in held.items()}
    (wanted.out / "rests.json").write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    console.print(f"{wanted.out / 'rests.json'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
