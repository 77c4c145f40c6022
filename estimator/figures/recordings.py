"""Figure of a corrected recording: rates, bias and quality over time."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bridge.recording import Recording
from bridge.wire.messages import Quality
from estimator.figures.style import AXES, COLOURS
from estimator.offline.corrected_recording import CorrectedRecording

Floats = NDArray[np.float64]


_BINS = 1500
#: least share of the recording, and least number of sample steps, of a gap that is shown
_SEEN, _STEPS = 1 / 300, 2.5
_SHADES = {"NONE": "#b0b0b0", "PRIOR": "#d9c7a0", "BIAS_ONLY": "#cdc6e6", "GOOD": "#ffffff", "DEGRADED": "#f0b7a8"}


class Bins(NamedTuple):
    """Division of samples into m bins, and the k points of the plotted line: one for each bin, two more for each gap.

    edges (m,): index of the first sample of each bin.
    time_s (k,): time of each point, s. shown (k,): index of the bin whose value each point has.
    The points of a gap are at the last sample before the gap, and at time NaN, so that no line crosses the gap.
    """

    edges: NDArray[np.int64]
    time_s: Floats
    shown: NDArray[np.int64]


def binned(time_s: Floats, rate_hz: float) -> Bins:
    """Divide samples at time_s (n,), s, into up to 1500 even bins for a plot, with a new bin after each gap.

    rate_hz: sample rate, Hz.
    """
    gaps = np.flatnonzero(np.diff(time_s) > max(_SEEN * time_s[-1], _STEPS / rate_hz)) + 1
    even = np.linspace(0, len(time_s), min(_BINS, len(time_s)) + 1).astype(int)[:-1]
    edges = np.unique(np.concatenate([even, gaps]))
    after = np.searchsorted(edges, gaps)
    shown = np.insert(np.arange(len(edges)), np.repeat(after, 2), np.repeat(after - 1, 2))
    last = after + 2 * np.arange(len(gaps))
    time = time_s[edges[shown]]
    time[last], time[last + 1] = time_s[gaps - 1], np.nan
    return Bins(edges, time, shown)


def corrected(recording: Recording, found: CorrectedRecording, path: Path) -> None:
    """Draw a corrected recording, one row per axis: raw and corrected rate (°/s), and bias ± 2 σ (°/s).

    recording: the raw rates. found: corrected rate, bias and quality of each of its samples. path: image file to write.
    The background shows the quality. Temperature (°C) is below, if recorded.
    """
    warm = recording.temperature_c
    rows = 3 if warm is None else 4
    figure = Figure(figsize=(12, 2.5 * rows + 1.0), dpi=130)
    grid = figure.subplots(rows, 2, sharex=True, squeeze=False, height_ratios=[1.0] * 3 + [0.6] * (rows - 3))
    unit, per = ("min", 60.0) if recording.time_s[-1] > 300 else ("s", 1.0)
    bins = binned(recording.time_s, recording.rate_hz)
    time, at = bins.time_s / per, bins.edges[bins.shown]
    for axis in range(3):
        _rates(grid[axis, 0], time, bins, recording.gyro[:, axis], found.rate[:, axis], axis)
        _tracked(grid[axis, 1], time, np.degrees(found.bias[at, axis]), np.degrees(found.bias_std[at, axis]), axis)
    for axes in grid[:3].ravel():
        _shade(axes, time, found.quality[at], recording.time_s[-1] / per)
    if warm is not None:
        for axes in grid[3]:
            axes.plot(time, warm[at], color=COLOURS[5])
            axes.set(ylabel="temperature, °C")
    for axes in grid[-1]:
        axes.set(xlabel=f"time, {unit}", xlim=(0, recording.time_s[-1] / per))
    how = "smoothed" if found.smoothed else "as live"
    figure.suptitle(f"{recording.name}, corrected {how}: {_qualities(found)}", fontsize=12)
    here = [name for name in _SHADES if name in found.seconds() and name != "GOOD"]
    patches = [Patch(facecolor=_SHADES[name], alpha=0.45, label=name) for name in here]
    if patches:
        figure.legend(
            handles=patches, loc="outside lower center", ncols=len(patches), title="quality where it is not GOOD"
        )
    figure.align_ylabels(grid)
    figure.savefig(path)


def _qualities(found: CorrectedRecording) -> str:
    seconds = found.seconds()
    return ", ".join(f"{name} {100 * part / sum(seconds.values()):.0f} %" for name, part in seconds.items())


def _rates(axes: Any, time: Floats, bins: Bins, raw: Floats, rate: NDArray[np.float32], axis: int) -> None:
    # Least to greatest value in each bin: a movement shorter than a pixel stays visible.
    for values, colour, label in ((raw, "#9a9a9a", "raw"), (rate, COLOURS[axis], "corrected")):
        low, high = (np.degrees(of.reduceat(values, bins.edges))[bins.shown] for of in (np.minimum, np.maximum))
        axes.fill_between(time, low, high, color=colour, linewidth=0.6, alpha=0.8, label=f"{AXES[axis]} {label}")
    axes.margins(y=0.2)  # room for the legend
    axes.set(ylabel=f"rate {AXES[axis]}, °/s")
    axes.legend(fontsize=8, ncols=2, loc="upper right")


def _tracked(axes: Any, time: Floats, bias: Floats, std: Floats, axis: int) -> None:
    axes.fill_between(time, bias - 2 * std, bias + 2 * std, color=COLOURS[axis], alpha=0.25, linewidth=0, label="± 2 σ")
    axes.plot(time, bias, color=COLOURS[axis], label=f"bias {AXES[axis]}")
    # The range comes from the known bias: in the first seconds nothing is known.
    near = std < 20 * max(float(np.median(std)), 1e-4)
    low, high = (bias - 3 * std)[near].min(), (bias + 3 * std)[near].max()
    room = 0.25 * (high - low)  # for the legend
    axes.set(ylabel=f"bias {AXES[axis]}, °/s", ylim=(low, high + room))
    axes.legend(fontsize=8, ncols=2, loc="upper right")


def _shade(axes: Any, time: Floats, quality: NDArray[np.uint8], end: float) -> None:
    gap = np.isnan(time)
    begins = np.concatenate([[0], np.flatnonzero((np.diff(quality.astype(int)) != 0) | np.diff(gap)) + 1])
    until = np.where(gap, np.roll(time, 1), time)  # a gap has no quality
    ends = [*until[begins[1:]], end]
    for begin, stop in zip(begins, ends, strict=True):
        name = Quality(int(quality[begin])).name
        if name != "GOOD" and not gap[begin]:
            axes.axvspan(time[begin], stop, color=_SHADES[name], alpha=0.45, linewidth=0, zorder=0)
