"""Figures of devices, noise and recordings, drawn with matplotlib.

Only this package, `study.figures` and `demo.figure` import matplotlib.
"""

from estimator.figures.histories import history
from estimator.figures.noise import allan
from estimator.figures.recordings import corrected

__all__ = [
    "allan",
    "corrected",
    "history",
]
