"""Report on the history of a device, as tables and as JSON."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from math import degrees
from typing import Any

import numpy as np
from rich.console import RenderableType

from bridge.reasons.catalogue import english, sentences_as_json
from bridge.runtime.logs import printable
from bridge.terminal.tables import Column, Columns
from bridge.wire.messages import Calibration
from estimator.geometry.gyro_model import AXES, SIGMAS
from estimator.guide.comparison import bias_moves
from estimator.service.history import Biases, History


def as_tables(history: History) -> Iterator[RenderableType]:
    """Yield tables of calibrations, placements, boots, commands, and the bias (°/s) at the end of each boot.

    Calibrations are accepted and refused ones. Empty tables are left out.
    """
    refused = [row for row in history.commands if row["verb"] == "calibrate"]
    tried = [(c.time_ns, _calibration(c, history.calibrations)) for c in history.calibrations]
    tried += [(row["time_ns"], ("", row["who"], "", f"{row['reason']}: {english(*row['message'])}")) for row in refused]
    yield from _table(
        "calibrations",
        ("when", "boot", "by", "scale x, y, z ± 95 %", "verdict"),
        [(when(time_ns), *rest) for time_ns, rest in sorted(tried)],
    )
    ends = [*(one.since_ns for one in history.placements[1:]), 0]
    yield from _table(
        "placements",
        ("from", "to", "by", "worn"),
        [
            (when(one.since_ns), when(end) if end else "now", one.who, str(one))
            for one, end in zip(history.placements, ends, strict=False)
        ],
    )
    yield from _table(
        "boots",
        ("when", "boot", "cause", "model"),
        [
            (when(row["time_ns"]), row["boot"], _words(row["cause"]), f"{row['model']} {row['firmware']}")
            for row in history.boots
        ],
    )
    yield from _table(
        "commands",
        ("when", "asked for", "by", "reason", "answer"),
        [
            (when(row["time_ns"]), row["verb"], row["who"], row["reason"], english(*row["message"]))
            for row in history.commands
            if row["verb"] != "calibrate"
        ],
    )
    yield from _table(
        "bias at the end of each boot, °/s",
        ("from", "to", "boot", *(f"{axis} ± 95 %" for axis in AXES), "°C"),
        [_bias(of) for of in history.biases],
    )


def as_json(history: History) -> dict[str, Any]:
    """Return a device's whole history as JSON-compatible values, in SI units, with times in ISO 8601.

    Keys: device; and the lists calibrations, placements, boots, commands and bias, each oldest first.
    An element of `bias` is one boot with m points: boot, time (m), bias_rad_s and bias_std_rad_s (m, 3), temperature_c
    (m; null where unknown).
    Keys of a calibration: id, time, boot, method, verdict, reason, who, matrix (3, 3), bias_rad_s (3), parameters,
    covariance, temperature_c. A placement has the fields of Placement; a boot or command has the columns of the table
    `boots` or `audit` of the store.
    """
    return {
        "device": history.device,
        "calibrations": [
            {
                "id": c.id,
                "time": iso(c.time_ns),
                "boot": f"{c.boot:016x}",
                "method": c.method,
                "verdict": c.verdict.name.lower(),
                "reason": sentences_as_json(c.reason),
                "who": c.who,
                "matrix": c.matrix.tolist(),
                "bias_rad_s": c.bias.tolist(),
                "parameters": list(c.parameters),
                "covariance": c.covariance.tolist(),
                "temperature_c": _number(c.temperature_c),
            }
            for c in history.calibrations
        ],
        "placements": [{**asdict(one), "since": iso(one.since_ns)} for one in history.placements],
        "boots": [{**row, "time": iso(row["time_ns"])} for row in history.boots],
        "commands": [
            {**row, "message": sentences_as_json(row["message"]), "time": iso(row["time_ns"])}
            for row in history.commands
        ],
        "bias": [
            {
                "boot": of.boot,
                "time": [iso(int(time)) for time in of.time_ns],
                "bias_rad_s": of.bias.tolist(),
                "bias_std_rad_s": of.std.tolist(),
                "temperature_c": [_number(t) for t in of.temperature_c],
            }
            for of in history.biases
        ],
    }


#: columns on a narrow terminal: times and numbers are never cut; `spare` columns are left out, the highest first
_WHOLE = 14
_SHOWN = {
    "when": Column("when", number=True),
    "from": Column("from", number=True),
    "to": Column("to", number=True, spare=2),
    "boot": Column("boot", number=True, spare=1),
    "°C": Column("°C", number=True, spare=3),
    "by": Column("by", spare=1),
    "cause": Column("cause", spare=2),
    "scale x, y, z ± 95 %": Column("scale x, y, z ± 95 %", least=_WHOLE),
}


def _table(title: str, headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> Iterator[Columns]:
    if not rows:
        return
    shown = Columns([_SHOWN.get(name) or Column(name, number="±" in name, least=12) for name in headings], title=title)
    for row in rows:
        shown.add(*map(printable, row))  # the store may come from elsewhere and hold control characters
    yield shown


def _calibration(c: Calibration, all_of_device: Sequence[Calibration]) -> tuple[str, ...]:
    std = np.sqrt(np.diag(c.covariance))
    known = dict(zip(c.parameters, std, strict=True))
    scale = " ".join(
        f"{c.matrix[axis, axis]:.4f}±{SIGMAS * known.get(f'k_{name}', np.nan):.4f}" for axis, name in enumerate(AXES)
    )
    verdict = f"{c.verdict.name.lower()} ({c.method}): {english(*c.reason)}"
    if moved := bias_moves(c, all_of_device):
        verdict += f" The bias has moved since the calibration before: {', '.join(AXES[axis] for axis in moved)}."
    return f"{c.boot:016x}", c.who, scale, verdict


def _bias(of: Biases) -> tuple[str, ...]:
    celsius = of.temperature_c[np.isfinite(of.temperature_c)]
    warm = f"{celsius.min():.1f}…{celsius.max():.1f}" if len(celsius) else ""
    last = (f"{degrees(b):+.3f}±{SIGMAS * degrees(s):.3f}" for b, s in zip(of.bias[-1], of.std[-1], strict=True))
    return when(int(of.time_ns[0])), when(int(of.time_ns[-1])), of.boot, *last, warm


def _words(name: str) -> str:
    return name.lower().replace("_", " ")


def when(time_ns: int) -> str:
    """Format a time, ns since the Unix epoch, as date and time in this machine's zone: `2026-11-21 13:39:19`."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")


def iso(time_ns: int) -> str:
    """Format a time, ns since the Unix epoch, as ISO 8601 in UTC, with milliseconds."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).isoformat(timespec="milliseconds")


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
