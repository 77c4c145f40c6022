"""A calibration in words and as JSON: the command line's view of a Result. Degrees live here, not in the core."""

from collections.abc import Iterator, Sequence
from math import degrees
from typing import Any

import numpy as np

from bridge.terminal.tables import Column, Columns
from bridge.wire.messages import Calibration
from estimator.calibration.result import Result
from estimator.geometry.gyro_model import AXES, SIGMAS
from estimator.offline import calibration_file


def as_json(result: Result, calibration: Calibration, passed_over: Sequence[str] = ()) -> dict[str, Any]:
    """Plain values: the calibration as it is loaded again, what to repeat, what each parameter was told, what did not count."""
    known = bool(np.all(np.isfinite(result.covariance)))
    bits = result.information_bits.tolist() if known else []
    return {
        **calibration_file.as_json(calibration),
        "repeat": [AXES[axis] for axis in result.repeat],
        "information_bits": dict(zip(result.parameters, bits, strict=True)) if known else None,
        "passed_over": list(passed_over),
    }


def recorded_as_json(calibration: Calibration) -> dict[str, Any]:
    """The same of one that was made live: there is nothing to repeat, and what it was told is not known."""
    return {**calibration_file.as_json(calibration), "repeat": [], "information_bits": None, "passed_over": []}


def first(lines: Sequence[str]) -> Iterator[str]:
    """Of many lines the first, and how many more `--json` has."""
    yield from lines[:_MOST]
    if (more := len(lines) - _MOST) > 0:
        yield f"… and {more} more; --json has them all"


_MOST = 12
_HEADINGS = {"axis": 0, "scale k": 0, "± 95 %": 0, "bias °/s": 0, "± 95 % °/s": 0}
_OF_TURNS = {"turn °": 1, "closed to °": 2, "s": 3}


def as_table(result: Result | Calibration) -> Columns:
    """Scale and bias of each axis, with 95 % intervals, and its turn, where the method has turns."""
    headings = _HEADINGS | (_OF_TURNS if result.turns else {})
    table = Columns([Column(heading, number=True, spare=spare) for heading, spare in headings.items()])
    wide = SIGMAS * np.sqrt(np.diag(result.covariance))
    turns = {turn.axis: turn for turn in result.turns}
    for axis, name in enumerate(AXES):
        turn = turns.get(axis)
        table.add(
            name,
            f"{result.matrix[axis, axis]:.5f}",
            f"{wide[3 + axis]:.5f}",
            f"{degrees(result.bias[axis]):+.4f}",
            f"{degrees(wide[axis]):.4f}",
            *(
                (f"{degrees(turn.angle):+.1f}", f"{degrees(turn.closure_error):.2f}", f"{turn.duration_s:.1f}")
                if turn
                else ()
            ),
        )
    return table


def as_matrix(result: Result | Calibration) -> Columns:
    """The whole matrix, row by row, each element with its 95 % interval."""
    table = Columns(
        [
            Column(heading, number=True)
            for heading in ("corrected, ± 95 %", "of reading x", "of reading y", "of reading z")
        ]
    )
    wide = dict(zip(result.parameters, SIGMAS * np.sqrt(np.diag(result.covariance)), strict=True))
    for i, row in enumerate(AXES):
        names = [f"k_{row}" if row == column else f"m_{row}{column}" for column in AXES]
        table.add(row, *(f"{result.matrix[i, j]:+.5f} ± {wide[name]:.5f}" for j, name in enumerate(names)))
    return table
