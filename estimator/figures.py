"""Every picture truerate makes; the only file that imports matplotlib."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bridge.recording import Recording
from bridge.wire.messages import Quality
from estimator.allan_fit import Noise, shapes
from estimator.allan_report import COEFFICIENTS, said
from estimator.corrected import Corrected
from estimator.demo.judge import Judgement
from estimator.identification import AtRest

Floats = NDArray[np.float64]
mpl.rcParams.update(
    {
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.alpha": 0.25,
        "font.size": 10,
        "axes.titlesize": 11,
        "legend.frameon": False,
        "figure.constrained_layout.use": True,
    }
)
_COLOURS = ("#0b6e99", "#d9730d", "#0f7b6c", "#ad1a72", "#6940a5", "#9f6b53", "#448361", "#c4554d")
_AXES = ("x", "y", "z")


def demo(boots: Sequence[Judgement], path: Path) -> None:
    """Heading error raw against corrected, tracked bias against truth, and scale factors against truth."""
    figure = Figure(figsize=(11, 8.5), dpi=130)
    grid = figure.subplots(2, 2)
    raw, left = (
        max(float(np.abs(h).max()) for h in headings)
        for headings in ([boot.raw_heading_deg for boot in boots], [boot.corrected_heading_deg for boot in boots])
    )
    figure.suptitle(
        f"{len(boots)} wearables after three hand turns each: raw rates lose the heading by up to {raw:.0f}°, "
        f"corrected rates by {left:.1f}°",
        fontsize=12,
    )
    _heading(grid[0, 0], boots, "raw_heading_deg", "Raw rates: heading error")
    _heading(
        grid[0, 1],
        boots,
        "corrected_heading_deg",
        f"Corrected rates: heading error ({raw / left:.0f} times finer scale)",
    )
    _bias(grid[1, 0], boots[0])
    _scale(grid[1, 1], boots)
    figure.savefig(path)


def _heading(axes: Any, boots: Sequence[Judgement], what: str, title: str) -> None:
    for boot, colour in zip(boots, _COLOURS * len(boots), strict=False):
        axes.plot(boot.time - boot.time[0], getattr(boot, what), color=colour, label=boot.device)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(title=title, xlabel="seconds since calibration", ylabel="heading error, degrees")
    axes.legend(fontsize=8, ncols=2)


def _bias(axes: Any, boot: Judgement) -> None:
    for axis, colour in zip(range(3), _COLOURS, strict=False):
        error = boot.bias_dps[:, axis] - boot.bias_true_dps[:, axis]
        std = boot.bias_std_dps[:, axis]
        axes.plot(boot.time, error, color=colour, label=f"{_AXES[axis]} estimate − truth")
        for side in (-2, 2):
            axes.plot(boot.time, side * std, color=colour, linewidth=0.8, linestyle=":")
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(
        title=f"Bias error of {boot.device}; dotted: ±2 σ as published", xlabel="seconds since power-up", ylabel="°/s"
    )
    axes.legend(fontsize=8)


def _scale(axes: Any, boots: Sequence[Judgement]) -> None:
    for number, boot in enumerate(boots):
        for axis, colour in zip(range(3), _COLOURS, strict=False):
            axes.errorbar(
                number + 0.2 * (axis - 1),
                100 * (boot.k[axis] / boot.k_true[axis] - 1),
                yerr=200 * boot.k_std[axis] / boot.k_true[axis],
                color=colour,
                fmt="o",
                markersize=4,
                capsize=2,
                label=_AXES[axis] if number == 0 else None,
            )
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(title="Scale factor error after three hand turns, with ±2 σ", ylabel="scale factor error, %")
    axes.set_xticks(range(len(boots)), [boot.device for boot in boots], rotation=30, ha="right")
    axes.legend(fontsize=8, ncols=3)


def histogram(panels: dict[str, tuple[Floats, str]], title: str, path: Path) -> None:
    """One histogram a panel: errors of a study and their unit, with their rms."""
    figure = Figure(figsize=(4 * len(panels), 3.6), dpi=130)
    figure.suptitle(title)
    rooms = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (name, (values, unit)) in zip(rooms, panels.items(), strict=True):
        axes.hist(values, bins=30, color=_COLOURS[0])
        axes.ticklabel_format(axis="x", style="sci", scilimits=(-2, 2))
        axes.locator_params(axis="x", nbins=5)
        axes.set(title=f"{name}: rms {np.sqrt(np.mean(values**2)):.1e}", xlabel=unit, ylabel="sessions")
    figure.savefig(path)


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """One panel: sizes of errors (n, 3) of each method for x, y, z, on a log axis, and named levels across it."""

    title: str
    unit: str
    sizes: dict[str, Floats]
    lines: dict[str, float]


def boxes(panels: Sequence[Boxes], title: str, path: Path) -> None:
    """Two panels a row, a box for each method and axis: half of the errors in the box, 95 % below the upper whisker."""
    figure = Figure(figsize=(11, 0.6 + 3.6 * -(-len(panels) // 2)), dpi=130)
    figure.suptitle(title)
    rooms = figure.subplots(-(-len(panels) // 2), 2, squeeze=False).ravel()
    for axes, panel in zip(rooms, panels, strict=False):
        for number, (method, values) in enumerate(panel.sizes.items()):
            drawn = axes.boxplot(
                values,
                positions=np.arange(3) + 0.36 * (number - (len(panel.sizes) - 1) / 2),
                widths=0.3,
                whis=(2.5, 95),
                showfliers=False,
                patch_artist=True,
                medianprops={"color": "black"},
            )
            for box in drawn["boxes"]:
                box.set(facecolor=_COLOURS[number], alpha=0.6, label=method if box is drawn["boxes"][0] else None)
        for number, (name, level) in enumerate(panel.lines.items()):
            axes.axhline(level, color="black", linewidth=1, linestyle=("--", ":")[number % 2], label=name)
        axes.set(title=panel.title, ylabel=panel.unit, yscale="log")
        axes.set_xticks(range(3), _AXES)
    handles, labels = rooms[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    figure.savefig(path)


_BINS = 1500
_SHADES = {"NONE": "#b0b0b0", "PRIOR": "#d9c7a0", "BIAS_ONLY": "#cdc6e6", "GOOD": "#ffffff", "DEGRADED": "#f0b7a8"}


def corrected(recording: Recording, found: Corrected, path: Path) -> None:
    """A row an axis: raw and corrected rate, and bias with ± 2 σ; the background is the quality; temperature below."""
    warm = recording.temperature_c
    rows = 3 if warm is None else 4
    figure = Figure(figsize=(12, 2.5 * rows + 1.0), dpi=130)
    grid = figure.subplots(rows, 2, sharex=True, squeeze=False, height_ratios=[1.0] * 3 + [0.6] * (rows - 3))
    unit, per = ("min", 60.0) if recording.time_s[-1] > 300 else ("s", 1.0)
    edges = np.unique(np.linspace(0, len(recording), min(_BINS, len(recording)) + 1).astype(int))[:-1]
    time = recording.time_s[edges] / per
    for axis in range(3):
        _rates(grid[axis, 0], time, edges, recording.gyro[:, axis], found.rate[:, axis], axis)
        _tracked(
            grid[axis, 1], time, np.degrees(found.bias[edges, axis]), np.degrees(found.bias_std[edges, axis]), axis
        )
    for axes in grid[:3].ravel():
        _shade(axes, time, found.quality[edges], recording.time_s[-1] / per)
    if warm is not None:
        for axes in grid[3]:
            axes.plot(time, warm[edges], color=_COLOURS[5])
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


def _qualities(found: Corrected) -> str:
    seconds = found.seconds()
    return ", ".join(f"{name} {100 * part / sum(seconds.values()):.0f} %" for name, part in seconds.items())


def _rates(
    axes: Any, time: Floats, edges: NDArray[np.int64], raw: Floats, rate: NDArray[np.float32], axis: int
) -> None:
    # From least to most in each bin: a movement shorter than a pixel is still seen.
    for values, colour, label in ((raw, "#9a9a9a", "raw"), (rate, _COLOURS[axis], "corrected")):
        low, high = (np.degrees(of.reduceat(values, edges)) for of in (np.minimum, np.maximum))
        axes.fill_between(time, low, high, color=colour, linewidth=0.6, alpha=0.8, label=f"{_AXES[axis]} {label}")
    axes.margins(y=0.2)  # room for the legend
    axes.set(ylabel=f"rate {_AXES[axis]}, °/s")
    axes.legend(fontsize=8, ncols=2, loc="upper right")


def _tracked(axes: Any, time: Floats, bias: Floats, std: Floats, axis: int) -> None:
    axes.fill_between(
        time, bias - 2 * std, bias + 2 * std, color=_COLOURS[axis], alpha=0.25, linewidth=0, label="± 2 σ"
    )
    axes.plot(time, bias, color=_COLOURS[axis], label=f"bias {_AXES[axis]}")
    # Seen from what is known in the end: the first seconds know nothing.
    near = std < 20 * max(float(np.median(std)), 1e-4)
    low, high = (bias - 3 * std)[near].min(), (bias + 3 * std)[near].max()
    axes.set(ylabel=f"bias {_AXES[axis]}, °/s", ylim=(low, high))
    axes.legend(fontsize=8, ncols=2, loc="upper right")


def _shade(axes: Any, time: Floats, quality: NDArray[np.uint8], end: float) -> None:
    begins = np.concatenate([[0], np.flatnonzero(np.diff(quality.astype(int))) + 1])
    ends = [*time[begins[1:]], end]
    for begin, until in zip(begins, ends, strict=True):
        name = Quality(int(quality[begin])).name
        if name != "GOOD":
            axes.axvspan(time[begin], until, color=_SHADES[name], alpha=0.45, linewidth=0, zorder=0)


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """One panel: a row a scenario, for each method the value in it (NaN for none), and the goal of each row."""

    title: str
    rows: Sequence[str]
    values: dict[str, list[float]]
    goals: Sequence[float]
    log: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BiasDay:
    """One axis of a bias over a day at hours (n,): truth and tracks (n,) °/s, and what was done, by number, with its names."""

    hours: Floats
    truth_dps: Floats
    tracks_dps: dict[str, Floats]
    activity: NDArray[np.int8]
    names: Sequence[str]


def tracking(panels: Sequence[Dots], day: BiasDay, methods: Sequence[str], path: Path) -> None:
    """Trackers side by side in four panels, the first the tallest; below, a day with its activities."""
    figure = Figure(figsize=(13, 12), dpi=130)
    rooms = figure.subplot_mosaic(
        [["0", "1"], ["0", "2"], ["0", "3"], ["day", "day"], ["strip", "strip"]], height_ratios=[2, 7, 2, 9, 0.6]
    )
    colours = dict(zip(methods, _COLOURS, strict=False))
    for name, panel in zip("0123", panels, strict=True):
        _dots(rooms[name], panel, colours)
    _tracks(rooms["day"], day, colours)
    _strip(rooms["strip"], rooms["day"], day)
    named = {
        label: handle for name in "0123" for handle, label in zip(*rooms[name].get_legend_handles_labels(), strict=True)
    }
    figure.legend(named.values(), named.keys(), loc="outside upper center", ncols=len(named))
    figure.savefig(path)


def _dots(axes: Any, panel: Dots, colours: dict[str, str]) -> None:
    if not panel.rows:
        axes.set_axis_off()
        return
    height = -np.arange(len(panel.rows))
    for number, (method, values) in enumerate(panel.values.items()):
        apart = 0.5 * (0.5 - number / max(1, len(panel.values) - 1))
        if not np.all(np.isnan(values)):
            axes.plot(values, height + apart, "o", color=colours[method], markersize=7, label=method)
    axes.plot(panel.goals, height, "|", color="black", markersize=22, markeredgewidth=2, label="goal")
    for edge in height[:-1] - 0.5:
        axes.axhline(edge, color="black", alpha=0.12, linewidth=0.8)
    axes.set(title=panel.title, xscale="log" if panel.log else "linear", ylim=(height[-1] - 0.5, 0.5))
    axes.set_yticks(height, panel.rows)
    axes.grid(visible=False, axis="y")


def _tracks(axes: Any, day: BiasDay, colours: dict[str, str]) -> None:
    axes.plot(day.hours, day.truth_dps, color="black", linewidth=5, alpha=0.4, zorder=2.5)
    for method, track in day.tracks_dps.items():
        ours = method.startswith("truerate")
        axes.plot(day.hours, track, color=colours[method], linewidth=1.3 if ours else 0.8, zorder=3 if ours else 2)
    low, high = day.truth_dps.min(), day.truth_dps.max()
    around = 0.6 * (high - low)
    axes.set(
        title="One axis of a gyro over a simulated day on a ward; broad and grey: the truth",
        ylabel="bias, °/s",
    )
    axes.set(xlim=(0, day.hours[-1]), ylim=(low - around, high + around))
    axes.tick_params(labelbottom=False)


def _strip(axes: Any, above: Any, day: BiasDay) -> None:
    shades = [mpl.colormaps["Set3"](number) for number in range(len(day.names))]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(day.activity)) + 1, [len(day.activity) - 1]])
    for begin, end in pairwise(edges):
        axes.axvspan(day.hours[begin], day.hours[end], color=shades[day.activity[begin]], linewidth=0)
    done = sorted(set(day.activity.tolist()))
    handles = [Patch(color=shades[number], label=day.names[number]) for number in done]
    axes.sharex(above)
    axes.set(xlabel="hours", yticks=[])
    axes.legend(handles=handles, ncols=len(done), fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -1.8))


def allan(rest: AtRest, title: str, path: Path) -> None:
    """A panel an axis: Allan deviation with its 95 % interval, the fitted model, and each noise or its upper limit."""
    figure = Figure(figsize=(13, 6), dpi=130)
    figure.suptitle(f"{title}: {rest.duration_s:.0f} s at rest, {rest.rate_hz:.4g} Hz", fontsize=12)
    rooms = figure.subplots(1, 3, sharey=True)
    for axes, noise, name in zip(rooms, rest.axes, _AXES, strict=True):
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
        (used, _COLOURS[0], "measured, 95 %"),
        (~used, "white", "not used: the device's filter"),
    ):
        axes.errorbar(
            noise.tau[chosen],
            measured[chosen],
            yerr=np.array([measured - low, high - measured])[:, chosen],
            color=_COLOURS[0],
            markerfacecolor=face,
            fmt="o",
            markersize=4,
            linewidth=1,
            capsize=2,
            label=label if chosen.any() else None,
        )
    tau = np.geomspace(noise.fitted_from, noise.tau[-1] * 1.5, 200)
    axes.plot(tau, np.degrees(noise.model(tau)), color="black", linewidth=1.4, label="fitted")
    for (field, words, unit, scale), colour, shape in zip(COEFFICIENTS, _COLOURS[1:], shapes(tau), strict=False):
        coefficient = getattr(noise, field)
        style = {"linestyle": "--"} if coefficient.seen else {"linestyle": ":", "alpha": 0.6}
        size = coefficient.value if coefficient.seen else coefficient.high
        axes.plot(
            tau, np.degrees(size) * shape, color=colour, label=f"{words} {said(coefficient, scale)} {unit}", **style
        )
    if noise.drift:
        axes.plot(
            tau, np.degrees(noise.drift) * shapes(tau)[3], color=_COLOURS[4], linestyle="--", label="steady drift"
        )
    axes.set(xscale="log", yscale="log")
    axes.legend(fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.14))
