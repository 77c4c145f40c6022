"""Every picture truerate makes; the only package that imports matplotlib."""

from estimator.figures.histories import history
from estimator.figures.noise import allan
from estimator.figures.recordings import corrected
from estimator.figures.wards import demo

__all__ = [
    "allan",
    "corrected",
    "demo",
    "history",
]
