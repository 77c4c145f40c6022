"""Figure of a device's history over days: bias, temperature, boots and calibrations."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO

import matplotlib as mpl
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
#: colours of a dark page
_DARK: dict[Any, str] = dict.fromkeys(
    ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), "#e8edf1"
)
_BRIGHT = ("#7fbaff", "#ffb066", "#4fcfa8")
_DARK |= {"figure.facecolor": "#171e24", "axes.facecolor": "#171e24", "savefig.facecolor": "#171e24"}
#: matplotlib's colours are those of the whole process: threads draw one after the other
_COLOURING = Lock()
#: date formats without month names: for years, months, days, hours, minutes, seconds
_NUMBERS = ["%Y", "%Y-%m", "%m-%d", "%H:%M", "%H:%M", "%S.%f"]
_NUMBERED = ["", "%Y", "%Y-%m", "%Y-%m-%d", "%Y-%m-%d", "%Y-%m-%d %H:%M"]


def history(
    of: History,
    path: Path | BinaryIO,
    zone: tzinfo = UTC,
    *,
    words: bool = True,
    dark: bool = False,
    narrow: bool = False,
) -> None:
    """Draw a device's bias (°/s) over days, each axis with its 95 % interval, and its temperature (°C) where known.

    of: the history to draw. path: image file to write. zone: time zone of the times shown.
    words: False draws only numbers, units and axes, for a page with its own explanation.
    dark: True for a dark page. narrow: True for a phone.
    Vertical lines mark boots and calibrations. No line connects one boot to the next. An interval far wider than usual,
    as at a boot's first point, is cut off by the edge of the figure; the label says so.
    """
    warm = any(np.isfinite(boot.temperature_c).any() for boot in of.biases)
    with _COLOURING, mpl.rc_context(_DARK if dark else {}):
        figure = Figure(figsize=(4.4, 6.6) if narrow else (12, 7), dpi=130)
        panels = figure.subplots(3 + warm, 1, sharex=True)
        for axis, panel in enumerate(panels[:3]):
            _bias(panel, axis, of.biases, zone, (_BRIGHT if dark else COLOURS)[axis], words=words)
        for boot in of.biases if warm else ():
            panels[3].plot(_dates(boot.time_ns, zone), boot.temperature_c, color=COLOURS[5], marker=_marker(boot))
        if warm:
            panels[3].set(ylabel="temperature, °C" if words else "°C")
        _across(panels, _dates([row["time_ns"] for row in of.boots], zone), "boot" if words else "", "grey", ":")
        made = _dates([c.time_ns for c in of.calibrations], zone)
        _across(panels, made, "calibration" if words else "", mpl.rcParams["text.color"], "--")
        _times(panels[-1], of, zone, words=words, narrow=narrow)
        if words:
            told = f"{count(len(of.calibrations), 'calibration')}, {count(len(of.boots), 'boot')}"
            zone_name = datetime.now(zone).tzname()
            figure.suptitle(f"{of.device}: {told} (bias in °/s; band: 95 %; times in {zone_name})", fontsize=12)
        handles, labels = panels[0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        figure.savefig(path)


def _bias(panel: Any, axis: int, biases: Sequence[Biases], zone: tzinfo, colour: str, *, words: bool) -> None:
    """Draw the bias of one axis, a line and a band for each boot."""
    for boot in biases:
        when, (bias, wide) = _dates(boot.time_ns, zone), (of_axes[:, axis] for of_axes in _band(boot))
        panel.fill_between(when, bias - wide, bias + wide, color=colour, alpha=0.25, linewidth=0)
        panel.plot(when, bias, color=colour, marker=_marker(boot), linewidth=1.2)
    cut = _fit(panel, biases, axis)
    panel.set(ylabel=f"{AXES[axis]}, °/s{', cut off' if cut and words else ''}")


def _marker(boot: Biases) -> str:
    return "." if len(boot.time_ns) < 30 else ""


def _times(panel: Any, of: History, zone: tzinfo, *, words: bool, narrow: bool) -> None:
    """Set the range of time to all that is shown, and label it."""
    all_of_it = sorted(
        _dates([row["time_ns"] for row in of.boots], zone) + _dates([c.time_ns for c in of.calibrations], zone)
    )
    all_of_it = sorted([*all_of_it, *(when for boot in of.biases for when in _dates(boot.time_ns[[0, -1]], zone))])
    if all_of_it:  # matplotlib ignores vertical lines when it chooses the range
        margin = max(_LEAST / 2, (all_of_it[-1] - all_of_it[0]) / 20)
        panel.set_xlim(all_of_it[0] - margin, all_of_it[-1] + margin)
    locator = AutoDateLocator(tz=zone, minticks=2 if narrow else 5, maxticks=6 if narrow else None)  # type: ignore[no-untyped-call]
    panel.xaxis.set_major_locator(locator)
    formats = {} if words else {"formats": _NUMBERS, "offset_formats": _NUMBERED}
    panel.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=zone, **formats))  # type: ignore[no-untyped-call]


def _band(of: Biases) -> tuple[Floats, Floats]:
    """(m, 3) bias and half width of its interval, °/s."""
    return np.degrees(of.bias), SIGMAS * np.degrees(of.std)


def _fit(panel: Any, biases: Sequence[Biases], axis: int) -> bool:
    """Set the range to show every known bias and usual band; returns whether some band is cut off."""
    if not biases:
        return False
    bias, wide = (np.concatenate(of_boots)[:, axis] for of_boots in zip(*map(_band, biases), strict=True))
    usual = float(np.percentile(wide, 50, method="lower"))
    shown, known = np.minimum(wide, _WIDE * usual), wide <= max(_WIDE * usual, _UNKNOWN)
    low, high = float((bias - shown)[known].min()), float((bias + shown)[known].max())
    margin = (high - low) / 20
    if margin:
        panel.set_ylim(low - margin, high + margin)
    return bool(((bias - wide < low - margin) | (bias + wide > high + margin)).any())


def _across(panels: Sequence[Any], when: list[datetime], label: str, colour: str, style: str) -> None:
    for panel in panels:
        for number, one in enumerate(when):
            panel.axvline(
                one, color=colour, linestyle=style, linewidth=1, label=label if label and not number else None
            )


def _dates(times_ns: NDArray[np.int64] | Sequence[int], zone: tzinfo) -> list[datetime]:
    return [datetime.fromtimestamp(time_ns / 1e9, zone) for time_ns in times_ns]
