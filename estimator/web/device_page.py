"""The page of one device as plain values: its tile, facts, calibrations, boots, notes, and what happened. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, isfinite, nan

from bridge.wire.messages import Calibration, DeviceInfo, State, Status
from estimator.guide.compare import stds
from estimator.gyro import AXES
from estimator.web import words
from estimator.web.known import Known, Story
from estimator.web.tiles import Tile, tile, troubles
from estimator.web.trail import Mark

#: 95 % of a normal distribution
_SIGMAS = 1.96
_RECALIBRATES = (State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING, State.TRACKING, State.DEGRADED)
_CANCELS = (State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING)


@dataclass(frozen=True, slots=True)
class CalibrationLine:
    """One calibration, accepted or not: scale of each axis with its interval of 95 %."""

    id: str
    time_ns: int
    when: str
    verdict: str
    method: str
    who: str
    scale: Sequence[str]
    bias: Sequence[str]
    turns: str
    reason: str
    in_use: bool


@dataclass(frozen=True, slots=True)
class Line:
    """A boot, a note or an event: when, who or what, and words."""

    time_ns: int
    when: str
    what: str
    words: str


@dataclass(frozen=True, slots=True)
class DevicePage:
    """Everything the device page shows beside its moving pictures."""

    ward: str
    time_ns: int
    connected: bool
    troubles: Sequence[str]
    tile: Tile
    progress: float
    can_recalibrate: bool
    can_cancel: bool
    facts: Sequence[tuple[str, str]]
    calibrations: Sequence[CalibrationLine]
    boots: Sequence[Line]
    notes: Sequence[Line]
    events: Sequence[Line]


def device_page(known: Known, device: str, now: float, now_ns: int) -> DevicePage:
    """What is to be shown now of a device that was heard of."""
    story = known.stories[device]
    row = known.row(device, now)
    status = story.status
    in_use = status.calibration if status else ""
    return DevicePage(
        ward=known.ward,
        time_ns=now_ns,
        connected=known.connected,
        troubles=troubles(known),
        tile=tile(row, story, now_ns),
        progress=status.progress if status else 0.0,
        can_recalibrate=status is not None and status.state in _RECALIBRATES,
        can_cancel=status is not None and status.state in _CANCELS,
        facts=_facts(story),
        calibrations=[_calibration(c, in_use) for c in reversed(story.calibrations.values())],
        boots=[Line(b.time_ns, words.clock(b.time_ns), b.what, b.cause) for b in reversed(story.boots.values())],
        notes=[Line(n.time_ns, words.clock(n.time_ns), n.who, n.text) for n in reversed(story.notes)],
        events=[_event(mark) for mark in sorted(story.trail.marks, key=lambda mark: -mark.time_ns)[:20]],
    )


def _calibration(c: Calibration, in_use: str) -> CalibrationLine:
    std = stds(c)
    return CalibrationLine(
        id=c.id,
        time_ns=c.time_ns,
        when=words.clock(c.time_ns),
        verdict=c.verdict.name.lower(),
        method=c.method,
        who=c.who,
        scale=[interval(float(c.matrix[i, i]), std.get(f"k_{axis}", nan), 4) for i, axis in enumerate(AXES)],
        bias=[
            interval(degrees(float(c.bias[i])), degrees(std.get(f"bias_{axis}", nan)), 3) for i, axis in enumerate(AXES)
        ],
        turns=", ".join(
            f"{AXES[t.axis]} {words.signed(degrees(t.angle), 0)}° closed to {degrees(t.closure_error):.2f}°"
            for t in c.turns
        ),
        reason=c.reason,
        in_use=c.id == in_use,
    )


def interval(value: float, std: float, digits: int) -> str:
    """`1.0123 ± 0.0008`, of 95 %; the value alone where its standard deviation is not known."""
    shown = f"{value:.{digits}f}".replace("-", words.MINUS)
    return f"{shown} ± {_SIGMAS * std:.{digits}f}" if isfinite(std) else shown


def _event(mark: Mark) -> Line:
    return Line(mark.time_ns, words.clock(mark.time_ns), mark.kind, mark.words)


def _facts(story: Story) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    if story.info is not None:
        found += _hardware(story.info)
    if story.status is not None:
        found += _counts(story.status)
    return [(name, value) for name, value in found if value]


def _hardware(info: DeviceInfo) -> list[tuple[str, str]]:
    dropped = ", ".join(f"{count} {reason}" for reason, count in info.dropped.items())
    return [
        ("model", f"{info.model} {info.firmware}".strip()),
        ("read by", f"{info.bridge}, driver {info.driver}"),
        ("port", info.port),
        ("range", f"±{degrees(info.gyro_range):.0f} °/s" if info.gyro_range else ""),
        ("sensors", ", ".join(["gyro", *["accelerometer"] * info.has_accel, *["thermometer"] * info.has_temperature])),
        ("clock", "its own" if info.has_clock else "none: its samples are counted"),
        ("trouble", info.trouble),
        ("not published", dropped),
    ]


def _counts(status: Status) -> list[tuple[str, str]]:
    dropped = sum(status.dropped.values())
    return [
        ("samples", f"{status.samples_in} in = {status.samples_out} corrected + {dropped} dropped"),
        ("dropped", ", ".join(f"{count} {reason}" for reason, count in status.dropped.items())),
        ("happened", ", ".join(f"{count} {name}" for name, count in sorted(status.events.items()) if count)),
        ("scale in use", " ".join(f"{k:.4f}" for k in status.scale)),
    ]
