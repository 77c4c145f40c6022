"""Content of a device's page as plain values: tile, facts, calibrations, boots, notes and events. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees

from bridge.wire.messages import AccelerometerCalibration, Calibration, DeviceInfo, Placement, State, Status
from estimator.geometry.gyro_model import AXES
from estimator.guide.comparison import bias_moves
from estimator.guide.guide import CALIBRATING
from estimator.language.texts import Texts
from estimator.noise.device_model import model_stated
from estimator.web import number_format as words
from estimator.web.device_trail import Mark
from estimator.web.guide_view import rows
from estimator.web.tiles import Tile, tile, troubles
from estimator.web.ward_state import Known, Story

_RECALIBRATES = (*CALIBRATING, State.TRACKING, State.DEGRADED)


@dataclass(frozen=True, slots=True)
class CalibrationLine:
    """One calibration, accepted or rejected, in words: scale factor and bias (°/s) of each axis with 95 % intervals.

    `turns` and `reason` have one line for each turn or sentence; `in_use`: the device is corrected by it.
    """

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
    """A boot, a note or an event as one line of a list on the page.

    time_ns: since the Unix epoch; when: the same in words; what: who or what; words: the text.
    """

    time_ns: int
    when: str
    what: str
    words: str


@dataclass(frozen=True, slots=True)
class DevicePage:
    """Everything that a device's page shows in one language, except its live charts.

    time_ns: of the content, since the Unix epoch. progress: of the calibration, 0 to 1. blocked: why nothing
    can be asked for, or empty. facts: (name, value) of hardware and counts. calibrations, boots, notes,
    events: the newest first.
    """

    ward: str
    title: str
    time_ns: int
    connected: bool
    troubles: Sequence[str]
    tile: Tile
    placement: Placement
    progress: float
    can_recalibrate: bool
    can_cancel: bool
    blocked: str
    facts: Sequence[tuple[str, str]]
    calibrations: Sequence[CalibrationLine]
    boots: Sequence[Line]
    notes: Sequence[Line]
    events: Sequence[Line]


def device_page(known: Known, device: str, now: float, now_ns: int, t: Texts, told: str = "") -> DevicePage:
    """Build the present content of a known device's page, in the language of `t`.

    now: monotonic time in s; now_ns: ns since the Unix epoch. told: device model that the ward file names, or empty.
    """
    story = known.stories[device]
    row = known.row(device, now)
    status = story.status
    in_use = status.calibration if status else ""
    shown, deaf = tile(row, story, now, now_ns, t), known.deaf(device)
    return DevicePage(
        ward=known.ward,
        title=f"{device}: {shown.word} · {known.ward}",
        time_ns=now_ns,
        connected=known.connected,
        troubles=troubles(known, t),
        tile=shown,
        placement=row.placement or Placement(),
        progress=status.progress if status else 0.0,
        can_recalibrate=not deaf and status is not None and status.state in _RECALIBRATES,
        can_cancel=not deaf and status is not None and status.state in CALIBRATING,
        blocked=t("device.blocked") if deaf else "",
        facts=_facts(story, told, t),
        calibrations=[_calibration(c, story, in_use, t) for c in reversed(story.calibrations.values())],
        boots=[
            Line(b.time_ns, words.clock(b.time_ns), b.what, t.label(b.cause)) for b in reversed(story.boots.values())
        ],
        notes=[Line(n.time_ns, words.clock(n.time_ns), n.who, n.text) for n in reversed(story.notes)],
        events=[_event(mark, t) for mark in sorted(story.trail.marks, key=lambda mark: -mark.time_ns)[:20]],
    )


def _calibration(c: Calibration, story: Story, in_use: str, t: Texts) -> CalibrationLine:
    result = rows(c, None)
    moved = ", ".join(AXES[axis] for axis in bias_moves(c, story.calibrations.values()))
    return CalibrationLine(
        id=c.id,
        time_ns=c.time_ns,
        when=words.clock(c.time_ns),
        verdict=t(f"report.{c.verdict.name.lower()}"),
        method=c.method,
        who=c.who,
        scale=[one.scale for one in result],
        bias=[one.bias for one in result],
        turns="\n".join(
            t(
                "words.axis",
                axis=AXES[turn.axis],
                angle=words.signed(degrees(turn.angle), 0),
                closure=f"{degrees(turn.closure_error):.2f}",
            )
            for turn in c.turns
        ),
        reason="\n".join([t.text(c.reason), *([t("device.bias_moved", axes=moved)] if moved else [])]),
        in_use=c.id == in_use,
    )


def _event(mark: Mark, t: Texts) -> Line:
    return Line(mark.time_ns, words.clock(mark.time_ns), t(f"event.{mark.kind}"), _mark_text(mark, t))


def _mark_text(mark: Mark, t: Texts) -> str:
    if isinstance(mark.words, tuple):
        return t.text(mark.words)
    return mark.words if mark.kind == "note" else t.label(mark.words)


def _facts(story: Story, told: str, t: Texts) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    if story.info is not None:
        found += _hardware(story.info, told, t)
    if story.status is not None:
        found += _counts(story.status, t)
    return [(t(f"fact.{name}"), value) for name, value in found if value]


def _hardware(info: DeviceInfo, told: str, t: Texts) -> list[tuple[str, str]]:
    sensors = ["gyro", *["accelerometer"] * info.has_accel, *["thermometer"] * info.has_temperature]
    return [
        ("model", f"{info.model} {info.firmware}".strip()),
        ("noise_model", _noise_model(told, model_stated(info.model), t)),
        ("read_by", t("fact.reader", bridge=info.bridge, driver=info.driver)),
        ("port", info.port),
        ("range", f"±{degrees(info.gyro_range):.0f} °/s" if info.gyro_range else ""),
        ("sensors", ", ".join(t(f"fact.{sensor}") for sensor in sensors)),
        ("clock", t("fact.own_clock") if info.has_clock else t("fact.no_clock")),
        ("trouble", t.text(info.trouble)),
        ("not_published", _counted(info.dropped, t)),
    ]


def _noise_model(told: str, stated: str, t: Texts) -> str:
    if told:
        return t("fact.from_file", model=told)
    return t("fact.from_device", model=stated) if stated else t("fact.no_model")


def _counts(status: Status, t: Texts) -> list[tuple[str, str]]:
    dropped = sum(status.dropped.values())
    return [
        ("samples", t("fact.law", taken=status.samples_in, out=status.samples_out, dropped=dropped)),
        ("dropped", _counted(status.dropped, t)),
        ("happened", _events(status.events, t)),
        ("scale", " ".join(f"{k:.4f}" for k in status.scale)),
        ("accelerometer_errors", accelerometer(status.accelerometer, t)),
    ]


def accelerometer(one: AccelerometerCalibration | None, t: Texts) -> str:
    """Format scale and bias (m/s²) of a calibrated accelerometer with 95 % intervals; empty for None.

    Without a calibration, the text says why there is none.
    """
    if one is None or not one.covariance:
        return t.text(one.reason) if one else ""
    of = zip(AXES, one.scale, one.bias, one.std[3:], one.std[:3], strict=True)
    return "; ".join(
        f"{axis} {words.interval(k, k_std, 4)}, {words.interval(b, b_std, 3)} m/s²" for axis, k, b, k_std, b_std in of
    )


def _events(counts: Mapping[str, int], t: Texts) -> str:
    """`gaps: 1, movement ignored: 2`: the count comes last, since most labels are plurals."""
    return ", ".join(t("words.counted", what=t.label(label), n=n) for label, n in sorted(counts.items()) if n)


def _counted(counts: Mapping[str, int], t: Texts) -> str:
    return ", ".join(f"{n} {t.label(label)}" for label, n in counts.items() if n)
