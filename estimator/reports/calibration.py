"""Calibration report as sentences, tables and JSON; tables use degrees, JSON uses SI units."""

from collections.abc import Iterator, Sequence
from math import degrees
from typing import Any

import numpy as np

from bridge.reasons.catalogue import english
from bridge.terminal.tables import Column, Columns
from bridge.wire.messages import AccelerometerCalibration, Calibration
from estimator.calibration.result import Result
from estimator.geometry.gyro_model import AXES, SIGMAS
from estimator.offline import calibration_file


def as_json(
    result: Result, calibration: Calibration, passed_over: Sequence[str] = (), notes: Sequence[str] = ()
) -> dict[str, Any]:
    """Return a new calibration as JSON-compatible values, in SI units.

    The object has the keys of a calibration file (`offline.calibration_file`), and four more: `repeat` (axes whose turns
    must be repeated), `information_bits` (by parameter; null without an estimate), `passed_over`, and `notes`.
    result: outcome of the estimation. calibration: the same as a record to save. passed_over: for each unused movement
    the reason. notes: assumptions and repairs made when the recording was read.
    """
    known = bool(np.all(np.isfinite(result.covariance)))
    bits = result.information_bits.tolist() if known else []
    return {
        **calibration_file.as_json(calibration),
        "repeat": [AXES[axis] for axis in result.repeat],
        "information_bits": dict(zip(result.parameters, bits, strict=True)) if known else None,
        "passed_over": list(passed_over),
        "notes": list(notes),
    }


def recorded_as_json(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration received from a live ward as JSON-compatible values, with the keys of `as_json`.

    The four keys that `as_json` adds to a calibration file are empty lists, or null for the information in bits.
    """
    return {
        **calibration_file.as_json(calibration),
        "repeat": [],
        "information_bits": None,
        "passed_over": [],
        "notes": [],
    }


def first(lines: Sequence[str]) -> Iterator[str]:
    """Yield the first 12 lines; if there are more, then a line that counts them and refers to `--json`."""
    yield from lines[:_MOST]
    if (more := len(lines) - _MOST) > 0:
        yield f"… and {more} more; --json lists all"


_MOST = 12
_HEADINGS = {"axis": 0, "scale k": 0, "± 95 %": 0, "bias °/s": 0, "± 95 % °/s": 0}
_OF_TURNS = {"turn °": 1, "closed to °": 2, "s": 3}


def as_table(result: Result | Calibration) -> Columns:
    """Return a table of scale factor and bias (°/s) per axis with 95 % intervals, and of the turns if there are any.

    Turns: angle and closure error in degrees, duration in s.
    """
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


def accelerometer_as_words(one: AccelerometerCalibration | None) -> Iterator[str]:
    """Yield lines on an accelerometer's calibration: its verdict; if accepted, scale factors and bias (m/s²).

    Values have 95 % intervals. Nothing is yielded for None.
    """
    if one is None:
        return
    yield f"accelerometer {one.verdict.name.lower()}: {english(*one.reason)}"
    if one.covariance:
        wide = [SIGMAS * std for std in one.std]
        scale = ", ".join(f"{AXES[i]} {one.scale[i]:.5f} ± {wide[3 + i]:.5f}" for i in range(3))
        bias = ", ".join(f"{AXES[i]} {one.bias[i]:+.4f} ± {wide[i]:.4f}" for i in range(3))
        yield f"  scale {scale}; bias {bias} m/s² (95 %)"


def as_notes(notes: Sequence[str]) -> list[str]:
    """Format the notes on a recording, one line each: assumptions and repairs made when it was read."""
    return [f"note: {words}" for words in notes]


def as_matrix(result: Result | Calibration) -> Columns:
    """Return a table of the calibration matrix (3, 3), without unit, each element with its 95 % interval."""
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
