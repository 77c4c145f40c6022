"""Style of all figures of truerate: axes and colours, and saving in three formats for publication."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

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
        "svg.hashsalt": "truerate",  # equal figures give equal files
    }
)

COLOURS = ("#0b6e99", "#d9730d", "#0f7b6c", "#ad1a72", "#6940a5", "#9f6b53", "#448361", "#c4554d")
AXES = ("x", "y", "z")
PAPER = "#b3261e"


def save(figure: Figure, stem: Path) -> None:
    """Save a figure in the folder of `stem` as STEM.svg, STEM.pdf and STEM.png."""
    figure.savefig(stem.with_name(f"{stem.name}.png"), dpi=150)
    figure.set_layout_engine("none")  # keep the layout: computing it takes longest
    figure.savefig(stem.with_name(f"{stem.name}.svg"), metadata={"Date": None})
    figure.savefig(stem.with_name(f"{stem.name}.pdf"), metadata={"CreationDate": None})
