"""Draws the layout of configs/monitoring/dashboard.json into docs/images/monitoring.svg: what each panel shows, and where."""

import json
import textwrap
from pathlib import Path

import matplotlib as mpl

mpl.use("svg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).parent.parent
COLOURS = {"stat": "#e3f1e4", "timeseries": "#eef2f8", "table": "#f7f0e3"}


def main() -> None:
    """Draw one box a panel, with title and description."""
    panels = json.loads((ROOT / "configs/monitoring/dashboard.json").read_text(encoding="utf-8"))["panels"]
    height = max(panel["gridPos"]["y"] + panel["gridPos"]["h"] for panel in panels)
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "truerate", "font.family": "sans-serif"})
    figure, axes = plt.subplots(figsize=(11, 11 * height / 24 * 0.42))
    figure.subplots_adjust(0, 0, 1, 1)
    axes.set(xlim=(0, 24), ylim=(height, 0))
    axes.axis("off")
    for panel in panels:
        x, y, w, h = (panel["gridPos"][name] for name in "xywh")
        colour = COLOURS[panel["type"]]
        axes.add_patch(
            FancyBboxPatch(
                (x + 0.15, y + 0.3),
                w - 0.3,
                h - 0.6,
                boxstyle="round,pad=0,rounding_size=0.15",
                fc=colour,
                ec="#9aa5b1",
            )
        )
        axes.text(x + 0.4, y + 0.6, panel["title"], va="top", fontsize=9, weight="bold")
        about = textwrap.fill(panel["description"], int(w * 6))
        axes.text(x + 0.4, y + 1.9, about, va="top", fontsize=7, color="#52606d")
    figure.savefig(ROOT / "docs/images/monitoring.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
