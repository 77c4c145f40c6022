"""Self-contained HTML report of all studies: a row for each table, figure and claim of Wang et al. 2024.

The figures and tables of each study follow.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import jinja2
from rich.console import Console

from bridge.cli.parser import sentence
from bridge.terminal.tables import Column, Columns
from estimator.study.runner import Done
from estimator.study.study import Finding

_HERE = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Item:
    """Table, figure or claim of Wang et al. 2024, as compared in the report.

    key: same key as in Finding.item. where: place in the paper. says: the claim in words. value: the paper's result.
    study: name of the study that computes our result.
    """

    key: str
    where: str
    says: str
    value: str
    study: str


ITEMS = (
    Item(
        "before", "Fig. 2", "Orientation by raw readings over ±360° about x, y, z", "significant error", "orientation"
    ),
    Item("typical", "Fig. 6", "A typical simulated session at 0.15 °/s", "one rest, three turns", "typical"),
    Item(
        "errors",
        "Fig. 7",
        "Errors of bias and scale in 15,000 simulated sessions: unbiased, most of them in a band",
        "median zero; ±5.5e-3 at 0.03 °/s, ±2.5e-2 at 0.15 °/s",
        "errors",
    ),
    Item(
        "testset",
        "Fig. 8, eq. 12",
        "Mean error of the rate on a test set, before and after",
        "3 % of before, at 0.03 °/s",
        "testset",
    ),
    Item("lsm9ds1", "Table 2", "LSM9DS1: four methods", "k within 0.0245, b within 0.0215 °/s (proposed)", "sensors"),
    Item(
        "icm-20948", "Table 3", "ICM20948: four methods", "k within 0.0088, b within 0.0067 °/s (proposed)", "sensors"
    ),
    Item("limits", "Abstract", "Errors of scale and bias are below", "2.5e-2 LSM9DS1, 1e-2 ICM20948", "sensors"),
    Item(
        "time",
        "Abstract, §4.5",
        "Calibrated in less than 30 s, accelerometer-aided accuracy in a twentieth of the time",
        "27 and 29 s; 570 and 565 s accelerometer-aided",
        "sensors",
    ),
    Item(
        "magnitude",
        "Fig. 9",
        "Magnitude of 25.42 °/s before and after",
        "after closer; ICM20948 coincides",
        "magnitude",
    ),
    Item(
        "after", "Fig. 10", "Orientation by calibrated rates over ±360°", "almost coincides with ideal", "orientation"
    ),
    Item("noise", "§4.4", "The estimates are biased by noise, and less so with less noise", "no figure", "analysis"),
    Item(
        "discretization", "§4.4", "The discretization error falls as the sampling rate rises", "no figure", "analysis"
    ),
    Item(
        "physical",
        "§2.3, §4.4",
        "Speed, direction and re-placement of the hand: the accuracy stays acceptable",
        "no figure",
        "analysis",
    ),
)


@dataclass(frozen=True, slots=True)
class Row:
    """Row of the report: a table, figure or claim of the paper, and our finding, or None if its study was not run."""

    item: Item
    finding: Finding | None


def rows(done: Sequence[Done]) -> list[Row]:
    """List all items of the paper, each with the finding of the study that computed it."""
    found = {finding.item: finding for one in done for finding in one.study.findings(one.results)}
    return [Row(item, found.get(item.key)) for item in ITEMS]


def summary(of: Sequence[Row]) -> Columns:
    """Build a table of the items and their findings for a terminal."""
    table = Columns(
        [Column("paper"), Column("what it says", least=16), Column("ours", least=24), Column("verdict", least=8)],
        title=f"{sum(row.finding is not None for row in of)} of {len(of)} tables, figures and claims computed",
    )
    for row in of:
        ours, verdict = (row.finding.ours, row.finding.verdict) if row.finding else ("not run", "–")
        table.add(row.item.where, row.item.says, ours, verdict)
    return table


def write(path: Path, done: Sequence[Done], *, quick: bool) -> None:
    """Write the HTML report to `path`, with the figures embedded.

    quick: True to note in the report that the runs were few.
    """
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(_HERE), autoescape=True)
    of = rows(done)
    verdicts = [row.finding.verdict for row in of if row.finding]
    page = environment.get_template("report.html").render(
        version=version("truerate"),
        rows=of,
        quick=quick,
        agree=verdicts.count("agrees"),
        part=verdicts.count("agrees in part"),
        differ=verdicts.count("differs"),
        studies=[_study(one) for one in done],
    )
    path.write_text(page, encoding="utf-8")


def _study(one: Done) -> dict[str, object]:
    shown = Console(width=100, no_color=True, force_terminal=False)
    with shown.capture() as captured:
        for table in one.study.tables(one.results):
            shown.print(table, highlight=False)
    return {
        "name": one.study.name,
        "does": sentence(one.study.does).removesuffix("."),
        "tables": captured.get(),
        "figures": [{"name": stem.name, "svg": _svg(stem)} for stem in one.figures],
    }


def _svg(stem: Path) -> str:
    return base64.b64encode(stem.with_name(f"{stem.name}.svg").read_bytes()).decode("ascii")
