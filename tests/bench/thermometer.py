"""What a thermometer's noise and steps do to the tracked bias: simulated half hours of worn devices. `make bench-tracking`.

Each device lives the same half hour with every thermometer; judged from the end of its first rest on: error, how sure the
tracker is, and the share of the truth within ± 1.96 σ. Writes nothing.
"""

import argparse
import sys
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from tests.bench.temperature import states
from tests.sim.day import Day, simulate_day

_RATE_HZ, _HOURS, _FIRST_REST_S = 52.0, 0.5, 60.0
#: K: white noise of a reading, and its least step; without a thermometer nothing is read
THERMOMETERS: dict[str, tuple[float, float] | None] = {
    "perfect": (0.0, 0.0),
    "noise 0.05 K": (0.05, 0.0),
    "noise 0.15 K": (0.15, 0.0),
    "steps of 0.5 K": (0.0, 0.5),
    "none": None,
}


def read(day: Day, thermometer: tuple[float, float] | None, seed: int) -> Day:
    """The day with what that thermometer reads of it."""
    if thermometer is None:
        return replace(day, temperature_c=np.full_like(day.temperature_c, np.nan))
    noise_k, step_k = thermometer
    celsius = day.temperature_c + noise_k * np.random.default_rng(seed).normal(size=len(day.temperature_c))
    return replace(day, temperature_c=(step_k * np.round(celsius / step_k) if step_k else celsius).astype(np.float32))


def judged(day: Day, *, accel: bool) -> tuple[float, float, float]:
    """Mean squares of error and of its standard deviation, (°/s)², and the share within ± 1.96 σ."""
    found = [s for s in states(day, None, accel=accel) if s.time > _FIRST_REST_S]
    now = np.searchsorted(day.time_s, [s.time for s in found])
    error, std = np.degrees([s.bias for s in found] - day.bias[now]), np.degrees([s.std for s in found])
    return float(np.mean(error**2)), float(np.mean(std**2)), float(np.mean(np.abs(error) < 1.96 * std))


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--devices", type=int, default=8, help="how many; eight take a minute")
    wanted, _ = asked.parse_known_args()  # --hours and --days are for those beside it
    console = Console()
    console.width = max(console.width, 100)
    found: dict[tuple[str, bool], list[tuple[float, float, float]]] = {}
    for seed in track(range(wanted.devices), "thermometer", console=console):
        day = simulate_day(seed, _HOURS, _RATE_HZ)
        for name, thermometer in THERMOMETERS.items():
            for accel in (True, False):
                found.setdefault((name, accel), []).append(judged(read(day, thermometer, seed), accel=accel))
    table = Table(
        title=f"Bias of {wanted.devices} devices, half an hour each", title_justify="left", box=None, pad_edge=False
    )
    for heading in ("thermometer", "", "error, °/s rms", "σ, °/s rms", "in ±1.96 σ, %"):
        table.add_column(heading, justify="right" if "σ" in heading or "°" in heading else "left", no_wrap=True)
    for (name, accel), rows in found.items():
        error, var, share = np.mean(rows, axis=0)
        how = "accelerometer-aided" if accel else "gyro only"
        table.add_row(name if accel else "", how, f"{np.sqrt(error):.4f}", f"{np.sqrt(var):.4f}", f"{100 * share:.1f}")
    console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
