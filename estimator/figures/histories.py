"""A device over days: its bias, and what happened to it."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bridge.wording import count
from estimator.figures.style import AXES, COLOURS
from estimator.history import History


def history(of: History, path: Path | BinaryIO) -> None:
    """The bias of each axis with its 95 % interval, boot by boot, boots and calibrations across it; temperature below."""
    figure = Figure(figsize=(12, 7), dpi=130)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    for number, boot in enumerate(of.biases):
        when = _dates(boot.time_ns)
        for axis, name in enumerate(AXES):
            bias, wide = np.degrees(boot.bias[:, axis]), 1.96 * np.degrees(boot.std[:, axis])
            above.fill_between(when, bias - wide, bias + wide, color=COLOURS[axis], alpha=0.25, linewidth=0)
            above.plot(
                when,
                bias,
                color=COLOURS[axis],
                marker="." if len(when) < 30 else "",
                label=name if not number else None,
            )
        below.plot(when, boot.temperature_c, color=COLOURS[5], marker="." if len(when) < 30 else "")
    _across(above, [row["time_ns"] for row in of.boots], "boot", "grey", ":")
    _across(above, [c.time_ns for c in of.calibrations], "calibration", "black", "--")
    above.set(ylabel="bias, °/s; band: 95 %")
    below.set(ylabel="temperature, °C")
    locator = AutoDateLocator()  # type: ignore[no-untyped-call]
    below.xaxis.set_major_locator(locator)
    below.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    figure.suptitle(
        f"{of.device}: {count(len(of.calibrations), 'calibration')}, {count(len(of.boots), 'boot')} (times in UTC)",
        fontsize=12,
    )
    handles, labels = above.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.savefig(path)


def _across(axes: Any, times_ns: list[int], label: str, colour: str, style: str) -> None:
    for number, when in enumerate(_dates(np.array(times_ns, np.int64))):
        axes.axvline(when, color=colour, linestyle=style, linewidth=1, label=label if not number else None)


def _dates(times_ns: NDArray[np.int64]) -> list[datetime]:
    return [datetime.fromtimestamp(time_ns / 1e9, UTC) for time_ns in times_ns]
