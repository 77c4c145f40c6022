"""Figures of readings and rates over time: a simulated session, and machine turns before and after calibration."""

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from estimator.figures.style import AXES, COLOURS, PAPER
from estimator.study.magnitude import Magnitude
from estimator.study.orientation import IDEAL, Orientation
from estimator.study.typical import Typical

_GREY = "#8a8a8a"
_TURN = {"x": COLOURS[0], "y": COLOURS[1], "z": COLOURS[2]}
_AFTER = {"turn360": (COLOURS[0], "by Algorithm 1"), "closure": (COLOURS[1], "by closure"),
          "paper": (PAPER, "by the paper's K and b")}  # fmt: skip


def typical(found: Typical) -> Figure:
    """Draw the readings of one session over time, °/s.

    Shading marks the turns found; dashed lines mark the simulated starts and ends of turns.
    """
    figure = Figure(figsize=(10, 4.6))
    axes = figure.subplots()
    for axis, reading in zip(AXES, found.reading_dps, strict=True):
        axes.plot(found.time_s, reading, color=_TURN[axis], linewidth=1, label=f"reading {axis}")
    for stage in found.found:
        axes.axvspan(stage.begin_s, stage.end_s, color=_TURN[stage.axis], alpha=0.1, linewidth=0)
    for stage in found.simulated:
        for at in (stage.begin_s, stage.end_s):
            axes.axvline(at, color="black", linewidth=0.8, linestyle="--")
    top = axes.get_ylim()[1]
    ends = [(0.0, found.found[0].begin_s, "rest $S_0$")] if found.found else []
    ends += [(s.begin_s, s.end_s, f"turn about {s.axis} $S_{i}$") for i, s in enumerate(found.found, 1)]
    for begin, end, words in ends:
        axes.text((begin + end) / 2, top, words, ha="center", va="bottom")
    axes.set(xlabel="time, s", ylabel="angular rate, °/s", xlim=(0, found.time_s[-1]))
    figure.suptitle(
        f"One simulated calibration session, noise {found.noise_dps:g} °/s, with the stages found in it", fontsize=13
    )
    handles, labels = axes.get_legend_handles_labels()
    handles += [
        Patch(color=_GREY, alpha=0.25, label="turn as found"),
        Line2D([], [], color="black", linestyle="--", linewidth=0.8, label="turn begins or ends, as simulated"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(labels) + 2)
    return figure


def magnitude(found: Magnitude) -> Figure:
    """Draw the magnitude of the rate (°/s) in six machine turns, before and after calibration.

    One panel per sensor, with its turns one after the other.
    """
    figure = Figure(figsize=(10, 3.5 * len(found.traces) + 0.8))
    figure.suptitle(
        f"Simulated sensors: magnitude of {found.rate_dps:g} °/s before and after calibration by hand (ramps left out)",
        fontsize=13,
    )
    for trace, axes in zip(found.traces, figure.subplots(len(found.traces), 1, squeeze=False)[:, 0], strict=True):
        axes.plot(trace.time_s, trace.dps["raw"], color=_GREY, linewidth=0.8)
        for name in ("paper", "turn360"):
            axes.plot(trace.time_s, trace.dps[name], color=_AFTER[name][0], linewidth=0.8, alpha=0.8)
        axes.axhline(found.rate_dps, color="black", linestyle="--", linewidth=1.4)
        for i, begin in enumerate(trace.begins_s):
            end = [*trace.begins_s, trace.time_s[-1]][i + 1]
            axes.text((begin + end) / 2, 1.01, f"{AXES[i // 2]} {('clockwise', 'counterclockwise')[i % 2]}", ha="center",
                      va="bottom", fontsize=9, transform=axes.get_xaxis_transform())  # fmt: skip
            if i:
                axes.axvline(begin, color=_GREY, linewidth=0.8, linestyle=":")
        axes.set(ylabel=f"{found.labels[trace.sensor]}\nmagnitude, °/s", xlabel="time, s", xlim=(0, trace.time_s[-1]))
    handles = [
        Line2D([], [], color=_GREY, label="before: readings"),
        *(Line2D([], [], color=_AFTER[n][0], label=f"after, {_AFTER[n][1]}") for n in ("turn360", "paper")),
        Line2D([], [], color="black", linestyle="--", label="true rate"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def orientation(found: Orientation) -> Figure:
    """Draw the angle (degrees) over machine turns of 360° and back, before and after calibration.

    One column per sensor: angles from readings, from calibrated rates, and the errors of the latter.
    """
    figure = Figure(figsize=(5.6 * len(found.labels), 9.4))
    figure.suptitle(
        "Simulated sensors: orientation while turned 360° clockwise and back about x, y and z in turn", fontsize=13
    )
    panels = figure.subplots(3, len(found.labels), sharex=True, sharey="row", squeeze=False)
    for column, (sensor, label) in enumerate(found.labels.items()):
        before, after, error = panels[:, column]
        begin_s = 0.0
        for trace in (trace for trace in found.traces if trace.sensor == sensor):
            time_s = [begin_s + t for t in trace.time_s]
            ideal = trace.deg[IDEAL]
            for axes, name, colour in ((before, "raw", _GREY), (after, "turn360", COLOURS[0])):
                axes.plot(time_s, trace.deg[name], color=colour, linewidth=2)
                axes.plot(time_s, ideal, color="black", linestyle="--", linewidth=1)
            for name, (colour, _) in _AFTER.items():
                off = [a - b for a, b in zip(trace.deg[name], ideal, strict=True)]
                error.plot(time_s, off, color=colour, linewidth=1.4)
            for axes in (before, after, error):
                axes.text(time_s[len(time_s) // 2], 0.97, f"about {trace.axis}", ha="center", va="top", fontsize=9,
                          transform=axes.get_xaxis_transform())  # fmt: skip
                axes.axvline(time_s[-1], color=_GREY, linewidth=0.8, linestyle=":")
            begin_s = time_s[-1]
        before.set_title(f"{label}, before: readings")
        after.set_title(f"{label}, after: calibrated by Algorithm 1")
        error.set_title(f"{label}, after: error, enlarged")
        error.set_xlabel("time, s")
    for axes, words in zip(
        panels[:, 0], ("angle, degrees", "angle, degrees", "error of the angle, degrees"), strict=True
    ):
        axes.set_ylabel(words)
    for row in panels:
        low, high = row[0].get_ylim()
        row[0].set_ylim(low, high + 0.12 * (high - low))
    handles = [
        Line2D([], [], color="black", linestyle="--", label="ideal"),
        Line2D([], [], color=_GREY, linewidth=2, label="readings"),
        *(Line2D([], [], color=colour, label=f"calibrated {words}") for colour, words in _AFTER.values()),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure
