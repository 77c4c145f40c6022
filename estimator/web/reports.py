"""Content of a calibration certificate and of a ward summary, as values for their templates in one language. Pure."""

from collections.abc import Collection
from math import degrees, isfinite
from typing import Any

import numpy as np

from bridge.wire.messages import Calibration, Status, Verdict
from estimator.geometry.gyro_model import AXES
from estimator.guide.comparison import last_before
from estimator.language.texts import Texts
from estimator.overview.ward import TRACKING, DeviceRow
from estimator.service.history import Biases, History
from estimator.web import number_format
from estimator.web.device_page import accelerometer
from estimator.web.guide_view import against, rows
from estimator.web.tiles import advice, explained, toned, troubles, word, worn
from estimator.web.ward_state import Known, Story

#: a bias this many times less certain than the best point is left out of a chart
_UNSURE = 20.0
#: a boot is known up to this long before its first bias, ns
_BEFORE_NS = 60 * 10**9


def certificate(
    c: Calibration,
    known: Collection[Calibration],
    status: Status | None,
    t: Texts,
    *,
    limit: float,
    due_days: float,
    now_ns: int,
) -> dict[str, Any]:
    """Build the certificate of a calibration, accepted or rejected, as values for its template in the language of `t`.

    known: all known calibrations of the device. status: its latest status, or None.
    limit: largest accepted relative error of a scale factor (`SessionKnobs.scale_limit`). due_days: days until a
    calibration is due again.
    now_ns: host time, ns since the Unix epoch.
    The result has the variables of templates/certificate.html. Its `matrix` is empty if only the diagonal was
    estimated. `next` is the key of the text that says what to do.
    """
    accepted, in_use = c.verdict is Verdict.ACCEPTED, status is not None and status.calibration == c.id
    newest = all(other.time_ns <= c.time_ns for other in known)
    before = last_before(c, known)
    whole = bool(np.any(c.matrix - np.diag(np.diag(c.matrix))))
    due_ns = c.time_ns + round(due_days * 86400e9)
    noise = " ".join(f"{degrees(float(std)):.3f}" for std in c.noise_std)
    again = now_ns > due_ns if in_use else newest and not accepted
    facts = [
        ("device", c.device),
        ("placement", worn(status.placement, t) if status else ""),
        ("what", f"{c.model} {c.firmware}".strip()),
        ("range", f"±{degrees(c.gyro_range):.0f} °/s" if c.gyro_range else ""),
        ("rate", f"{c.rate_hz:g} Hz" if c.rate_hz else ""),
        ("when", number_format.clock(c.time_ns)),
        ("who", c.who or t("report.nobody")),
        ("method", c.method),
        ("reason", t.text(c.reason)),
        ("temperature", number_format.temperature(c.temperature_c)),
        ("noise", f"{noise} °/s" if np.any(c.noise_std) else ""),
        ("limit", t("report.within", percent=f"{100 * limit:.3g}") if isfinite(limit) else ""),
        ("accelerometer", accelerometer(c.accelerometer, t)),
        ("boot", f"{c.boot:016x}"),
        ("id", c.id),
    ]
    return {
        "device": c.device,
        "verdict": t(f"report.{c.verdict.name.lower()}"),
        "accepted": accepted,
        "in_use": in_use,
        "next": "again" if again else "keep" if in_use else "elsewhere",
        "when": number_format.clock(c.time_ns)[:10],
        "due": number_format.clock(due_ns)[:10],
        "overdue": now_ns > due_ns,
        "facts": [(t(f"report.{name}"), value) for name, value in facts if value],
        "result": rows(c, before) if c.parameters else (),
        "matrix": [[f"{value:.5f}".replace("-", number_format.MINUS) for value in row] for row in c.matrix]
        if whole
        else (),
        "turns": [
            {
                "axis": AXES[turn.axis],
                "angle": f"{number_format.signed(degrees(turn.angle), 1)}°",
                "closure": f"{degrees(turn.closure_error):.2f}°",
                "duration": f"{turn.duration_s:.1f} s",
            }
            for turn in c.turns
        ],
        "compared": against(c, before, t) if c.parameters else "",
    }


def summary(known: Known, now: float, t: Texts) -> dict[str, Any]:
    """Build the ward summary as the variables of templates/report.html.

    Keys: `devices` (all, by name), `needs` (those that need a person, most urgent first), `tracking` and `of` (number
    of tracking devices and of all), `troubles` (faults of the ward).
    now: monotonic time, s.
    """
    found = known.rows(now)
    lines = {row.device: _line(row, known.stories[row.device], t) for row in found}
    return {
        "tracking": sum(row.state == "tracking" for row in found),
        "of": len(found),
        "troubles": troubles(known, t),
        "needs": [lines[row.device] for row in found if row.needs_person],
        "devices": [lines[name] for name in sorted(lines)],
    }


def _line(row: DeviceRow, story: Story, t: Texts) -> dict[str, Any]:
    """One device in the ward summary; `result` is its calibration, a row for each axis."""
    status = story.status
    made = story.calibrations.get(status.calibration) if status else None
    return {
        "device": row.device,
        "placement": worn(row.placement, t),
        "state": word(row.state, t),
        "tone": toned(row),
        "reason": t.text(row.notices if row.state == TRACKING else explained(row.reason)),
        "advice": advice(row, story, t),
        "calibrated": number_format.clock(status.calibrated_time_ns) if status and status.calibrated_time_ns else "",
        "who": made.who if made else "",
        "battery": number_format.battery(row.battery_percent, t, charging=row.charging),
        "result": rows(made, None) if made else (),
    }


def past(story: Story, device: str) -> History:
    """Return a device's bias history for a chart, one part for each boot, with its calibrations and boots.

    A point is left out if its largest standard deviation exceeds 20 times that of the most certain point. Such points
    would hide the present bias in the chart.
    """
    times_ns, points = story.trail.times_ns, story.trail.points
    if (stored := story.biases) is not None and len(times_ns):
        before = stored.time_ns < times_ns[0]
        rows = np.column_stack([stored.bias, stored.std, stored.temperature_c])
        times_ns, points = np.append(stored.time_ns[before], times_ns), np.append(rows[before], points, axis=0)
    known = np.isfinite(points[:, :6]).all(axis=1)
    best = points[known, 3:6].max(axis=1, initial=0).min(initial=np.inf)
    shown = known & (np.nan_to_num(points[:, 3:6], nan=np.inf).max(axis=1) <= _UNSURE * best)
    biases = [
        Biases("", times_ns[part], points[part, :3], points[part, 3:6], points[part, 6])
        for run in np.split(np.arange(len(points)), np.flatnonzero(~known))
        if len(part := run[shown[run]]) > 1
    ]
    if not biases:
        return History(device, (), (), (), ())
    since_ns = biases[0].time_ns[0] - _BEFORE_NS
    boots = [{"time_ns": boot.time_ns} for boot in story.boots.values() if boot.time_ns >= since_ns]
    made = [c for c in story.calibrations.values() if c.time_ns >= since_ns]
    return History(device, made, boots, (), biases)
