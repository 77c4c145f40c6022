"""Figure of a device's noise: the Allan deviation of each axis."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from estimator.figures.style import AXES, COLOURS
from estimator.noise.allan_fit import Noise, shapes
from estimator.offline.noise_identification import AtRest
from estimator.reports.noise import COEFFICIENTS, said

Floats = NDArray[np.float64]


def allan(rest: AtRest, title: str, path: Path) -> None:
    """Draw the Allan deviation (°/s) of each axis over the averaging time (s), and write the figure to `path`.

    Shown: measured values with 95 % interval, fitted model, and each kind of noise or its upper limit.
    rest: noise of a recording at rest, fitted per axis. title: title of the figure.
    """
    figure = Figure(figsize=(13, 6), dpi=130)
    figure.suptitle(f"{title}: {rest.duration_s:.0f} s at rest, {rest.rate_hz:.4g} Hz", fontsize=12)
    rooms = figure.subplots(1, 3, sharey=True)
    for axes, noise, name in zip(rooms, rest.axes, AXES, strict=True):
        _allan(axes, noise)
        axes.set(title=f"axis {name}", xlabel="averaging time τ, s")
    lowest = min(float(noise.low.min()) for noise in rest.axes)
    highest = max(float(noise.high.max()) for noise in rest.axes)
    rooms[0].set(ylabel="Allan deviation of the rate, °/s", ylim=np.degrees([lowest / 3, highest * 1.2]))
    figure.savefig(path)


def _allan(axes: Any, noise: Noise) -> None:
    measured, low, high = (np.degrees(values) for values in (noise.deviation, noise.low, noise.high))
    used = noise.tau >= noise.fitted_from
    for chosen, face, label in (
        (used, COLOURS[0], "measured, 95 %"),
        (~used, "white", "not used: the device's filter"),
    ):
        axes.errorbar(
            noise.tau[chosen],
            measured[chosen],
            yerr=np.array([measured - low, high - measured])[:, chosen],
            color=COLOURS[0],
            markerfacecolor=face,
            fmt="o",
            markersize=4,
            linewidth=1,
            capsize=2,
            label=label if chosen.any() else None,
        )
    tau = np.geomspace(noise.fitted_from, noise.tau[-1] * 1.5, 200)
    axes.plot(tau, np.degrees(noise.model(tau)), color="black", linewidth=1.4, label="fitted")
    for (field, words, unit, scale), colour, shape in zip(COEFFICIENTS, COLOURS[1:], shapes(tau), strict=False):
        coefficient = getattr(noise, field)
        style = {"linestyle": "--"} if coefficient.seen else {"linestyle": ":", "alpha": 0.6}
        size = coefficient.value if coefficient.seen else coefficient.high
        axes.plot(
            tau, np.degrees(size) * shape, color=colour, label=f"{words} {said(coefficient, scale)} {unit}", **style
        )
    if noise.drift:
        axes.plot(tau, np.degrees(noise.drift) * shapes(tau)[3], color=COLOURS[4], linestyle="--", label="steady drift")
    axes.set(xscale="log", yscale="log")
    axes.legend(fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.14))
