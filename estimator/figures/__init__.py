"""Every picture truerate makes; the only package that imports matplotlib."""

from estimator.figures.histories import history
from estimator.figures.noise import allan
from estimator.figures.recordings import corrected
from estimator.figures.studies import Curves, curves, scaling
from estimator.figures.trackers import BiasDay, Dots, tracking
from estimator.figures.wards import demo

__all__ = [
    "BiasDay",
    "Curves",
    "Dots",
    "allan",
    "corrected",
    "curves",
    "demo",
    "history",
    "scaling",
    "tracking",
]
