"""A calibration in words and as JSON: the command line's view of a Result. Degrees live here, not in the core."""

from math import degrees
from typing import Any

import numpy as np
from rich.table import Table

from estimator.batch.result import Result
from estimator.gyro import AXES


def as_json(result: Result) -> dict[str, Any]:
    """Plain values; matrix, bias and covariance are null when there is no estimate."""
    known = bool(np.all(np.isfinite(result.covariance)))
    return {
        "method": result.method,
        "verdict": result.verdict.name.lower(),
        "reason": result.reason,
        "repeat": [AXES[axis] for axis in result.repeat],
        "matrix": result.matrix.tolist() if known else None,
        "bias_rad_s": result.bias.tolist() if known else None,
        "parameters": list(result.parameters),
        "covariance": result.covariance.tolist() if known else None,
        "information_bits": dict(zip(result.parameters, result.information_bits.tolist(), strict=True))
        if known
        else None,
        "noise_std_rad_s": result.noise_std.tolist() if known else None,
        "turns": [
            {
                "axis": AXES[turn.axis],
                "angle_deg": degrees(turn.angle),
                "closure_error_deg": degrees(turn.closure_error),
                "duration_s": turn.duration_s,
            }
            for turn in result.turns
        ],
    }


def as_table(result: Result) -> Table:
    """Scale, bias and turn of each axis, with standard deviations."""
    table = Table(title=None, box=None, pad_edge=False)
    for heading in ("axis", "scale k", "±", "bias °/s", "±", "turn °", "closed to °", "s"):
        table.add_column(heading, justify="right")
    std = np.sqrt(np.diag(result.covariance))
    turns = {turn.axis: turn for turn in result.turns}
    for axis, name in enumerate(AXES):
        turn = turns.get(axis)
        table.add_row(
            name,
            f"{result.scale[axis]:.5f}",
            f"{std[3 + axis]:.5f}",
            f"{degrees(result.bias[axis]):+.4f}",
            f"{degrees(std[axis]):.4f}",
            *(
                (f"{degrees(turn.angle):+.1f}", f"{degrees(turn.closure_error):.2f}", f"{turn.duration_s:.1f}")
                if turn
                else ()
            ),
        )
    return table


def as_matrix(result: Result) -> Table:
    """The whole matrix, row by row, each element with its standard deviation in brackets."""
    table = Table(title=None, box=None, pad_edge=False)
    for heading in ("corrected", "of reading x", "of reading y", "of reading z"):
        table.add_column(heading, justify="right")
    std = dict(zip(result.parameters, np.sqrt(np.diag(result.covariance)), strict=True))
    for i, row in enumerate(AXES):
        names = [f"k_{row}" if row == column else f"m_{row}{column}" for column in AXES]
        table.add_row(row, *(f"{result.matrix[i, j]:+.5f} ({std[name]:.5f})" for j, name in enumerate(names)))
    return table
