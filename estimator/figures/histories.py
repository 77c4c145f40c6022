"""Figure of a device's history over days: bias, temperature, boots and calibrations."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bridge.terminal.plurals import count
from bridge.wire.messages import Floats
from estimator.figures.style import AXES, COLOURS
from estimator.geometry.gyro_model import SIGMAS
from estimator.service.history import Biases, History

#: least time span of the figure, for a device just switched on
_LEAST = timedelta(minutes=2)
#: a band this many times the usual width is cut off by the edge of the figure; a bias whose band is also wider than
#: _UNKNOWN, °/s, as at the begin of a boot, does not affect the range
_WIDE, _UNKNOWN = 5.0, 1.0
#: date formats without month names: for years, months, days, hours, minutes, seconds
_NUMBERS = ["%Y", "%Y-%m", "%m-%d", "%H:%M", "%H:%M", "%S.%f"]
_NUMBERED = ["", "%Y", "%Y-%m", "%Y-%m-%d", "%Y-%m-%d", "%Y-%m-%d %H:%M"]


def history(of: History, path: Path | BinaryIO, zone: tzinfo = UTC, *, words: bool = True) -> None:
    """Draw the bias of each axis with its 95 % interval, boots and calibrations as vertical lines, and the temperature.

    A band far wider than usual, as at a boot's first point, is cut off by the edge of the figure; the label says so.
    words: False leaves only numbers, units and axes, for a page that explains the figure in its own language.
    """
    figure = Figure(figsize=(12, 7), dpi=130)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    for number, boot in enumerate(of.biases):
        when = _dates(boot.time_ns, zone)
        for axis, (name, bias, wide) in enumerate(zip(AXES, *(of_axes.T for of_axes in _band(boot)), strict=True)):
            above.fill_between(when, bias - wide, bias + wide, color=COLOURS[axis], alpha=0.25, linewidth=0)
            above.plot(
                when,
                bias,
                color=COLOURS[axis],
                marker="." if len(when) < 30 else "",
                label=name if not number else None,
            )
        below.plot(when, boot.temperature_c, color=COLOURS[5], marker="." if len(when) < 30 else "")
    begun = _dates([row["time_ns"] for row in of.boots], zone)
    _across(above, begun, "boot" if words else "", "grey", ":")
    made = _dates([c.time_ns for c in of.calibrations], zone)
    _across(above, made, "calibration" if words else "", "black", "--")
    all_of_it = sorted([*begun, *made, *(when for boot in of.biases for when in _dates(boot.time_ns[[0, -1]], zone))])
    if all_of_it:  # matplotlib ignores vertical lines when it chooses the range
        margin = max(_LEAST / 2, (all_of_it[-1] - all_of_it[0]) / 20)
        below.set_xlim(all_of_it[0] - margin, all_of_it[-1] + margin)
    cut = _fit(above, of.biases)
    above.set(ylabel=f"bias, °/s; band: 95 %{', cut off where it is wide' if cut else ''}" if words else "°/s")
    below.set(ylabel="temperature, °C" if words else "°C")
    locator = AutoDateLocator(tz=zone)  # type: ignore[no-untyped-call]
    below.xaxis.set_major_locator(locator)
    formats = {} if words else {"formats": _NUMBERS, "offset_formats": _NUMBERED}
    below.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=zone, **formats))  # type: ignore[no-untyped-call]
    if words:
        told = f"{count(len(of.calibrations), 'calibration')}, {count(len(of.boots), 'boot')}"
        zone_name = datetime.now(zone).tzname()
        figure.suptitle(f"{of.device}: {told} (times in {zone_name})", fontsize=12)
    handles, labels = above.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.savefig(path)


def _band(of: Biases) -> tuple[Floats, Floats]:
    """(m, 3) bias and half width of its interval, °/s."""
    return np.degrees(of.bias), SIGMAS * np.degrees(of.std)


def _fit(axes: Any, biases: Sequence[Biases]) -> bool:
    """Set the range to show every known bias and usual band; returns whether some band is cut off."""
    if not biases:
        return False
    bias, wide = map(np.concatenate, zip(*map(_band, biases), strict=True))
    usual = float(np.percentile(wide, 50, method="lower"))
    shown, known = np.minimum(wide, _WIDE * usual), wide <= max(_WIDE * usual, _UNKNOWN)
    low, high = float((bias - shown)[known].min()), float((bias + shown)[known].max())
    margin = (high - low) / 20
    if margin:
        axes.set_ylim(low - margin, high + margin)
    return bool(((bias - wide < low - margin) | (bias + wide > high + margin)).any())


def _across(axes: Any, when: list[datetime], label: str, colour: str, style: str) -> None:
    for number, one in enumerate(when):
        axes.axvline(one, color=colour, linestyle=style, linewidth=1, label=label if label and not number else None)


def _dates(times_ns: NDArray[np.int64] | Sequence[int], zone: tzinfo) -> list[datetime]:
    return [datetime.fromtimestamp(time_ns / 1e9, zone) for time_ns in times_ns]
