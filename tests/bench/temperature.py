"""What a temperature law learnt in earlier boots is worth in the first ten minutes of the next. `make bench-tracking`.

A simulated device warms up on its wearer; its tracked bias is kept every minute as the service keeps it, and the law is learnt
from that. Three ways on: with all sensors, without an accelerometer, and with temperature alone once the first rest is over.
The bound is what nobody can better who reads this gyro. Writes out/temperature.json.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bridge.wire.messages import BootCause, DeviceInfo
from estimator.geometry.gyro_model import GyroModel
from estimator.service.store import Store
from estimator.service.store_access import HISTORY_S
from estimator.stillness.detector import Stillness
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import OWN, BiasState
from estimator.tracking.temperature_law import TemperatureLaw
from estimator.tracking.temperature_learning import learn
from estimator.tracking.track_knobs import TrackKnobs
from estimator.tracking.tracker import Tracker
from tests.sim.day import Day, simulate_day, worn_spec
from tests.sim.warmth import ROOM_C

_RATE_HZ, _NAME = 52.0, "chest"
#: the device lies on a table for so long, and is judged from then on
_FIRST_REST_S, _JUDGED_S = 60.0, 600.0
_SCALE_STD, _NOISE_STD = 0.002, 2e-3
_KNOBS = TrackKnobs()
#: of a law that is true, rad/s/K and rad/s/K²: no better is possible
_TURN_ON = np.radians(3.0)
_EXACT = np.diag(np.radians([1e-4, 1e-5]) ** 2)
WAYS = {"all sensors": (True, np.inf), "no accelerometer": (False, np.inf), "temperature alone": (True, _FIRST_REST_S)}
WHO = (
    "first boot",
    "second, nothing learnt",
    "second, learnt from one boot",
    "second, learnt from three",
    "second, true law",
)


def states(day: Day, law: TemperatureLaw | None, *, accel: bool = True, until_s: float = np.inf) -> Iterator[BiasState]:
    """The tracked bias about every second; after until_s by its own walk and temperature alone."""
    nothing, scale = np.zeros(3), np.full(3, _SCALE_STD)
    model = GyroModel(np.eye(3), nothing, scale, scale, np.full(3, _NOISE_STD))
    tracker = Tracker(_KNOBS, 0.0, model, np.full(3, _TURN_ON), law)
    stillness, alone = Stillness(), None
    gyro, force = day.gyro.astype(float), day.accel.astype(float) if accel else None
    for windows in stillness.feed(day.time_s, gyro, force, celsius=day.temperature_c).each():
        ((_, now, last, _),) = windows.heads
        if now > until_s:
            if alone is None:
                known = tracker.state
                own = replace(known, x=known.x[:OWN], P=known.P[:OWN, :OWN])
                alone = BiasFilter(own, _KNOBS.bias, law)
            alone.predict(now, float(day.temperature_c[last]))
            yield alone.state
        else:
            tracker.take(windows)
            yield tracker.state


def judged(day: Day, law: TemperatureLaw | None, *, accel: bool, until_s: float) -> dict[str, float]:
    """Of the first ten minutes: error, °/s rms, the worst of it, and the share within ± 1.96 σ, %."""
    found = [s for s in states(day, law, accel=accel, until_s=until_s) if _FIRST_REST_S < s.time < _JUDGED_S]
    now = np.searchsorted(day.time_s, [s.time for s in found])
    error = np.degrees([s.bias for s in found] - day.bias[now].astype(float))
    std = np.degrees([s.std for s in found])
    return {
        "rms": float(np.sqrt(np.mean(error**2))),
        "worst": float(np.abs(error).max()),
        "covered": 100 * float(np.mean(np.abs(error) < 1.96 * std)),
    }


def keep(store: Store, boot: int, day: Day) -> None:
    """What the service would write of a boot."""
    store.add_boot(_info(boot), boot * 10**15)
    last = -np.inf
    for state in states(day, None):
        sure = bool(np.all(state.std < _KNOBS.bias_std))
        if sure and state.time - last >= HISTORY_S:
            store.save_bias(_NAME, boot, boot * 10**15 + round(state.time * 1e9), state, history=True)
            last = state.time


def measure(seed: int, hours: float, folder: Path) -> dict[str, dict[str, dict[str, float]]]:
    """What is found of one device: way, who, what."""
    store, laws = Store(folder / f"{seed}.sqlite3"), []
    boots = [1, 2, 3]
    for boot in boots:
        keep(store, boot, simulate_day(seed, hours, _RATE_HZ, boot=boot))
        laws.append(learn(store.points(_info(99)), _KNOBS.bias))
    store.close()
    short = _JUDGED_S / 3600
    first, second = (simulate_day(seed, short, _RATE_HZ, boot=boot) for boot in (boots[0], 99))
    true = second.truth
    exact = TemperatureLaw(ROOM_C, true.bias_per_kelvin, true.bias_per_kelvin2, np.tile(_EXACT, (3, 1, 1)))
    tried = ((first, None), (second, None), (second, laws[0]), (second, laws[-1]), (second, exact))
    return {
        way: {who: judged(day, law, accel=accel, until_s=until_s) for who, (day, law) in zip(WHO, tried, strict=True)}
        for way, (accel, until_s) in WAYS.items()
    }


def shown(results: list[dict[str, dict[str, dict[str, float]]]]) -> Table:
    """Medians over the devices, of the ratios, too; and the ratio of what is rms over all of them."""
    table = Table(
        title="Bias error in the first ten minutes, °/s: medians", title_justify="left", box=None, pad_edge=False
    )
    for heading in ("", "", "rms", "of nothing\nlearnt", "of first\nboot", "all\ntogether", "worst", "in ±1.96 σ, %"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for way in WAYS:
        nothing, first = (np.array([one[way][name]["rms"] for one in results]) for name in (WHO[1], WHO[0]))
        for who in WHO:
            rms, worst, covered = (
                np.array([one[way][who][what] for one in results]) for what in ("rms", "worst", "covered")
            )
            table.add_row(
                way if who == WHO[0] else "",
                who,
                f"{np.median(rms):.4f}",
                *(f"{np.median(rms / of):.2f}" for of in (nothing, first)),
                f"{np.sqrt(np.mean(rms**2) / np.mean(first**2)):.2f}",
                f"{np.median(worst):.3f}",
                f"{np.median(covered):.0f}",
            )
        bound = bound_dps()
        ratios = (f"{np.median(bound / of):.2f}" for of in (nothing, first))
        together = f"{bound / np.sqrt(np.mean(first**2)):.2f}"
        table.add_row("", "bound, always at rest, true law", f"{bound:.4f}", *ratios, together, "–", "–")
    return table


def bound_dps() -> float:
    """°/s, the Cramér-Rao bound of the bias where the law and the true rate of every second were known: noise and walk are left.

    The filtered variance P of a walk q seen with noise r each second: P² + q P = q r.
    """
    spec = worn_spec(_RATE_HZ)
    q, r = spec.rrw_dps_per_sqrt_s**2, spec.noise_dps**2 / _RATE_HZ
    return float(np.sqrt((np.sqrt(q * q + 4 * q * r) - q) / 2))


def _info(boot: int) -> DeviceInfo:
    return DeviceInfo(
        _NAME, "bridge", boot, BootCause.POWER_UP, "m", "1.0", "native", "p", _RATE_HZ, _RATE_HZ, 8.7, True, True, 1
    )  # fmt: skip


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--hours", type=float, default=2.0, help="of each boot that is learnt from")
    asked.add_argument("--days", type=int, default=24, help="how many devices")
    asked.add_argument("--out", type=Path, default=Path("out"))
    wanted = asked.parse_args()
    console = Console()
    console.width = max(console.width, 120)
    with tempfile.TemporaryDirectory() as folder:
        seeds = track(range(wanted.days), "temperature", console=console)
        results = [measure(seed, wanted.hours, Path(folder)) for seed in seeds]
    console.print(shown(results) if results else "no devices")
    wanted.out.mkdir(parents=True, exist_ok=True)
    (wanted.out / "temperature.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    console.print(f"{wanted.out / 'temperature.json'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
