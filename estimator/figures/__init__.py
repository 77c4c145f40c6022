"""Every picture truerate makes; the only package that imports matplotlib."""

from estimator.figures.histories import history
from estimator.figures.noise import allan
from estimator.figures.recordings import corrected
from estimator.figures.studies import Boxes, Curves, boxes, curves, histogram, scaling
from estimator.figures.trackers import BiasDay, Dots, tracking
from estimator.figures.wards import demo

__all__ = [
    "BiasDay",
    "Boxes",
    "Curves",
    "Dots",
    "allan",
    "boxes",
    "corrected",
    "curves",
    "demo",
    "histogram",
    "history",
    "scaling",
    "tracking",
]
