"""Which error makes the orientation's standard deviations as large as they are? `python -m tests.bench.orientation_terms`.

The covariance adds what each unknown error of the sensors does. Here each is left out in turn; the attitudes stay the same,
because the gain does not depend on them. Columns as in orientation.py.
"""

import argparse
import sys
from functools import partial
from unittest import mock

import numpy as np
from rich.console import Console

from estimator.device import correction
from estimator.geometry.gyro_model import GyroModel
from estimator.orientation.attitude import known
from tests.bench.orientation import Floats, on_broad, on_days, ours, shown

ALL = "all of these"
TERMS = "nothing", "bias", "matrix", "accelerometer", ALL


def without(
    term: str, model: GyroModel, bias_std: Floats, std: Floats, flicker: float, walk: float, accel: Floats
) -> Floats:
    """`orientation.attitude.known`, with one error said not to be there."""
    bias, matrix, accelerometer = (float(term not in (one, ALL)) for one in TERMS[1:4])
    std = std * np.repeat([matrix, accelerometer], [9, 3])
    return known(model, bias_std * bias, std, flicker * bias, walk * bias, accel)


def main() -> int:
    """Print the tables; no verdict."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--days", type=int, default=6, help="simulated days of 18 minutes; 0 for none")
    wanted, console = asked.parse_args(), Console(width=110)
    kinds = {f"BROAD, told {model}": partial(on_broad, ours(model)) for model in ("generic", "factory-calibrated")}
    if wanted.days:
        kinds["simulated days"] = partial(on_days, ours("icm-20948"), "icm-20948", wanted.days, 0.3)
    for kind, run in kinds.items():
        scores = {}
        for term in TERMS:
            with mock.patch.object(correction, "known", partial(without, term)):
                scores[f"without {term}"] = list(run())
        console.print(shown(kind, scores))
    return 0


if __name__ == "__main__":
    sys.exit(main())
