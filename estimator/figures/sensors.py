"""The paper's tables 2 and 3 as a figure: what each method finds of a sensor, beside what the paper found."""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from estimator.figures.style import COLOURS, PAPER, save
from estimator.study.sensors import METHODS, WORDS, Sensors
from estimator.study.simulation import PARAMETERS


def sensor(found: Sensors, name: str, stem: Path) -> None:
    """Six panels, k above b: each method's median and 95 % of its sessions, as differences from the truth."""
    figure = Figure(figsize=(11, 6.4))
    n = max(one.sessions for one in found.sessions)
    figure.suptitle(
        f"{found.labels[name]}: difference from the turntable column, {n} simulated sessions by each method", fontsize=13
    )
    panels = figure.subplots(2, 3, sharex=True, sharey="row")
    for i, (parameter, axes) in enumerate(zip(PARAMETERS, panels.ravel(), strict=True)):
        axes.axhline(0.0, color="black", linewidth=1)
        for at, (method, colour) in enumerate(zip(METHODS, COLOURS, strict=False)):
            for row in (row for row in found.of(name, method) if row.parameter == parameter):
                axes.vlines(at, *row.error.band, color=colour, linewidth=7, alpha=0.35)
                axes.plot(at, row.error.median, "o", color=colour, markersize=6)
                if row.paper is not None and method != "turntable":
                    axes.plot(at, row.paper - row.truth, "D", color=PAPER, markersize=6)
        symbol, unit = parameter[0], "°/s" if parameter[0] == "b" else "no unit"
        axes.set(title=f"${symbol}_{parameter[-1]}$", ylabel=f"difference of ${symbol}$ ({unit})" if i % 3 == 0 else "")
        axes.set_xticks(range(len(METHODS)), [WORDS[m].replace("-", "-\n") for m in METHODS], rotation=45, ha="right")
        axes.grid(visible=False, axis="x")
    handles = [
        Line2D([], [], marker="o", color="#555555", linestyle="none", label="median of the simulated sessions"),
        Line2D([], [], color="#555555", linewidth=7, alpha=0.35, label="95 % of the simulated sessions"),
        Line2D([], [], marker="D", color=PAPER, linestyle="none", label="the paper's value"),
        Line2D([], [], color="black", linewidth=1, label="the paper's turntable column, the truth here"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    save(figure, stem)
