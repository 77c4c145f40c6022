"""Box plots of the simulation of Wang et al. 2024: errors of the parameters, and of the rate on a test set."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from estimator.figures.style import COLOURS, PAPER
from estimator.study.errors import Errors
from estimator.study.simulation import METHODS, PARAMETERS, WORDS
from estimator.study.spread import Spread
from estimator.study.testset import AXES, BEFORE, Testset

_SYMBOLS = {name: f"${name[0]}_{name[-1]}$" for name in PARAMETERS}


def errors(found: Errors) -> Figure:
    """Draw box plots of the errors of k (no unit) and b (°/s), one row per noise.

    The left panel shows all parameters on the scale of the paper's band. The right panel shows the scale factors
    enlarged.
    """
    noises = [one.noise_dps for one in found.honesty]
    figure = Figure(figsize=(11, 3.6 * len(noises) + 0.9))
    runs = found.rows[0].error.n
    figure.suptitle(f"Estimated minus true parameters, {runs:,} simulated sessions at each noise", fontsize=13)
    for letter, noise, (whole, enlarged) in zip(
        "abcd", noises, figure.subplots(len(noises), 2, squeeze=False, width_ratios=(3, 2)), strict=False
    ):
        for method, colour, shift in zip(METHODS, COLOURS, (-0.19, 0.19), strict=False):
            rows = found.of(noise, method)
            _boxes(whole, {i + shift: row.error for i, row in enumerate(rows)}, colour)
            _boxes(enlarged, {i + shift: row.error for i, row in enumerate(rows[:3])}, colour)
            for i, row in enumerate(rows[:3]):
                if method == METHODS[-1]:
                    for sign in (-1, 1):
                        enlarged.hlines(sign * 1.96 * row.bound, i - 0.4, i + 0.4, color="black", linestyle=":")
        band = found.of(noise, METHODS[0])[0].paper_band
        for sign in (-1, 1):
            whole.axhline(sign * band, color=PAPER, linestyle="--", linewidth=1.2)
        whole.set(
            title=f"({letter}) noise {noise:g} °/s: all parameters",
            ylabel="error of $k$ (no unit), of $b$ (°/s)",
            ylim=(-1.25 * band, 1.25 * band),
        )
        whole.set_xticks(range(6), [_SYMBOLS[name] for name in PARAMETERS])
        enlarged.set(title=f"noise {noise:g} °/s: scale factors, enlarged", ylabel="error of $k$ (no unit)")
        enlarged.set_xticks(range(3), [_SYMBOLS[name] for name in PARAMETERS[:3]])
        enlarged.ticklabel_format(axis="y", style="sci", scilimits=(-2, 2))
        whole.ticklabel_format(axis="y", style="sci", scilimits=(-2, 2))
    handles: list[Patch | Line2D] = [
        *(Patch(color=colour, alpha=0.6, label=WORDS[m]) for m, colour in zip(METHODS, COLOURS, strict=False)),
        Line2D([], [], color=PAPER, linestyle="--", label="paper: most errors within"),
        Line2D([], [], color="black", linestyle=":", label="Cramér–Rao bound, ±1.96 standard deviations"),
    ]
    _legend(figure, handles)
    return figure


def testset(found: Testset) -> Figure:
    """Draw box plots of the test set's mean errors (°/s) before and after calibration, one row per noise."""
    noises = list(dict.fromkeys(row.noise_dps for row in found.rows))
    figure = Figure(figsize=(9.5, 3.4 * len(noises) + 0.9))
    runs = found.rows[0].error.n
    figure.suptitle(
        f"Mean error $e_l$ of the rate on a test set, {runs:,} simulated sessions at each noise", fontsize=13
    )
    for noise, (before, after) in zip(noises, figure.subplots(len(noises), 2, squeeze=False), strict=True):
        raw = found.of(noise, BEFORE)
        _boxes(before, {i: row.error for i, row in enumerate(raw)}, "#8a8a8a", width=0.5)
        for method, colour, shift in zip(METHODS, COLOURS, (-0.19, 0.19), strict=False):
            _boxes(after, {i + shift: row.error for i, row in enumerate(found.of(noise, method))}, colour)
        before.set(title=f"before calibration, noise {noise:g} °/s", ylabel="mean error, °/s")
        after.set(title=f"after calibration, noise {noise:g} °/s", ylabel="mean error, °/s")
        if noise == found.paper_left_noise_dps:
            level = found.paper_left * (sum(row.error.rms**2 for row in raw) / len(raw)) ** 0.5
            for sign in (-1, 1):
                before.axhline(sign * level, color=PAPER, linestyle="--", linewidth=1.2)
            high = max(map(abs, after.get_ylim()))
            words = f"paper: {100 * found.paper_left:g} % of before = ±{level:.2f} °/s,"
            words += f"\n{level / high:.0f} times the largest whisker"
            after.text(0.02, 0.98, words, color=PAPER, transform=after.transAxes, va="top", fontsize=9)
            after.set_ylim(-high * 1.35, high * 1.35)
        for axes in (before, after):
            axes.set_xticks(range(3), AXES)
            axes.set_xlabel("axis")
    handles = [Patch(color="#8a8a8a", alpha=0.6, label="readings")]
    handles += [Patch(color=colour, alpha=0.6, label=WORDS[m]) for m, colour in zip(METHODS, COLOURS, strict=False)]
    line = Line2D([], [], color=PAPER, linestyle="--", label=f"paper: {100 * found.paper_left:g} % of before")
    _legend(figure, [*handles, line])
    return figure


def _boxes(axes: Axes, at: Mapping[float, Spread], colour: str, width: float = 0.3) -> None:
    """Draw boxes (half of the errors) with whiskers (95 %) at the given positions."""
    drawn = axes.bxp(
        [
            {"med": s.median, "q1": s.quartiles[0], "q3": s.quartiles[1], "whislo": s.band[0], "whishi": s.band[1]}
            for s in at.values()
        ],
        positions=list(at),
        widths=width,
        showfliers=False,
        patch_artist=True,
        medianprops={"color": "black"},
    )
    for box in drawn["boxes"]:
        box.set(facecolor=colour, alpha=0.6)
    axes.grid(visible=False, axis="x")


def _legend(figure: Figure, handles: Sequence[Patch | Line2D]) -> None:
    figure.legend(
        handles=list(handles),
        loc="outside lower center",
        ncols=len(handles),
        title="box: half of the sessions, whiskers: 95 %, line: median",
        title_fontsize=10,
    )
