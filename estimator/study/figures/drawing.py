"""Drawing of a study's figures, by the name of the study."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from estimator.figures.style import save
from estimator.study.figures.real import real
from estimator.study.figures.sensors import sensor
from estimator.study.figures.simulations import errors, testset
from estimator.study.figures.sweeps import analysis
from estimator.study.figures.traces import magnitude, orientation, typical

_FIGURES: dict[str, Callable[[Any], Figure]] = {
    "typical": typical,
    "errors": errors,
    "testset": testset,
    "magnitude": magnitude,
    "orientation": orientation,
    "analysis": analysis,
    "real": real,
}


def draw(study: str, found: Any, folder: Path) -> list[str]:
    """Draw the results of a study into `folder`, one figure or one per sensor; return the figures' names without suffix."""
    figures = (
        {name: sensor(found, name) for name in found.labels} if study == "sensors" else {study: _FIGURES[study](found)}
    )
    for name, figure in figures.items():
        save(figure, folder / name)
    return list(figures)
