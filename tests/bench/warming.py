"""How honest a corrected recording is about a bias that warms up while no temperature tells of it. `make bench-tracking`.

Simulated days of worn devices from power-up on, corrected offline with the temperature taken away: the error of the bias,
the standard deviation that came with it, and how often the truth is within ±1.96 of it. Writes nothing.
"""

import argparse
import sys

import numpy as np
from rich.console import Console
from rich.table import Table

from bridge.recording import Recording
from estimator.offline.recordings import correct
from tests.sim.day import Day, simulate_day

_RATE_HZ, _FIRST_REST_S, _LATE_S = 52.0, 60.0, 600.0
#: what is left of the recording: temperature, accelerometer, from when on, and whether it is said to be warm
CASES = {
    "all of it": (True, True, 0.0, False),
    "no temperature": (False, True, 0.0, False),
    "no temperature, gyro only": (False, False, 0.0, False),
    "no temperature, begun 10 min later": (False, True, _LATE_S, False),
    "no temperature, said to be warm": (False, True, 0.0, True),
}


def recording(day: Day, *, temperature: bool, accel: bool, since_s: float = 0.0) -> Recording:
    """What is left of a day."""
    kept = day.time_s >= since_s
    return Recording(
        time_s=day.time_s[kept] - day.time_s[kept][0],
        gyro=day.gyro[kept].astype(np.float64),
        accel=day.accel[kept].astype(np.float64) if accel else None,
        temperature_c=day.temperature_c[kept].astype(np.float64) if temperature else None,
        rate_hz=day.rate_hz,
        name="day",
    )


def judged(
    day: Day, of: Recording, since_s: float = 0.0, *, warmed_up: bool = False, smooth: bool = False
) -> list[float]:
    """Share within ±1.96 σ, NEES/dof, error and σ in °/s rms, after the first rest."""
    found = correct(of, warmed_up=warmed_up, smooth=smooth)
    after = of.time_s > _FIRST_REST_S
    error = (found.bias - day.bias[day.time_s >= since_s])[after].astype(np.float64)
    std = found.bias_std[after].astype(np.float64)
    z = error / std
    rms = [float(np.degrees(np.sqrt(np.mean(each**2)))) for each in (error, std)]
    return [100 * float(np.mean(np.abs(z) < 1.96)), float(np.mean(z**2)), *rms]


def main() -> int:
    """Print a table; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--hours", type=float, default=0.5, help="of each day")
    asked.add_argument("--days", type=int, default=10, help="how many devices")
    wanted = asked.parse_args()
    days = [simulate_day(10 + seed, wanted.hours, _RATE_HZ) for seed in range(wanted.days)]
    table = Table(title="Bias of a device that warms up", title_justify="left", box=None, pad_edge=False)
    for heading in ("", "", "in ±1.96 σ, %", "worst day", "NEES/dof", "error, °/s", "σ, °/s"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for name, (temperature, accel, since_s, warmed_up) in CASES.items():
        for smooth in (False, True):
            rows = np.array(
                [
                    judged(
                        day,
                        recording(day, temperature=temperature, accel=accel, since_s=since_s),
                        since_s,
                        warmed_up=warmed_up,
                        smooth=smooth,
                    )
                    for day in days
                ]
            )
            covered, nees, error, std = rows.mean(axis=0)
            how = "smoothed" if smooth else "real time"
            worst = f"{rows[:, 0].min():.0f}"
            table.add_row(name, how, f"{covered:.1f}", worst, f"{nees:.2f}", f"{error:.4f}", f"{std:.4f}")
    console = Console()
    console.width = max(console.width, 110)
    console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
