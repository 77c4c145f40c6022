"""Figures of devices, noise and recordings. Only this room, `study.figures` and `demo.figure` import matplotlib.

Begin at `style`.
"""

from estimator.figures.histories import history
from estimator.figures.noise import allan
from estimator.figures.recordings import corrected

__all__ = [
    "allan",
    "corrected",
    "history",
]
