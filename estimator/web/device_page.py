"""Content of a device's page as plain values: tile, facts, calibrations, boots, notes and events. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees

from bridge.wire.messages import AccelerometerCalibration, Calibration, DeviceInfo, Placement, State, Status
from estimator.geometry.gyro_model import AXES
from estimator.guide.comparison import bias_moves
from estimator.language.texts import Texts
from estimator.noise.device_model import model_stated
from estimator.overview.ward import ENDED, SILENT, UNKNOWN, DeviceRow
from estimator.web import number_format as words
from estimator.web.device_trail import Mark
from estimator.web.guide_view import can_cancel, rows
from estimator.web.tiles import Tile, failed, tile, troubles
from estimator.web.ward_state import Known, Story

_RECALIBRATES = (State.TRACKING, State.DEGRADED)
#: states in which a turn of the device would not be seen
_UNSEEN = ("lost", SILENT, UNKNOWN, ENDED)


#: a boot, a note or an event as one line of a list: when, who or what, and the text
Line = tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class DevicePage:
    """Content of a device's page in one language, without its live charts.

    progress: of the calibration, 0 to 1. guide: text of the link to the guide. can_calibrate: True if turns of the
    device would be noticed. blocked: why no command can be given, or empty.
    facts: (name, value) of hardware and counts. calibrations: for each, whether it is in use, and the texts of its
    table row. boots, notes, events: for each, three texts. All four lists have the newest first.
    """

    title: str
    troubles: Sequence[str]
    tile: Tile
    placement: Placement
    progress: float
    guide: str
    can_calibrate: bool
    can_recalibrate: bool
    can_cancel: bool
    blocked: str
    facts: Sequence[tuple[str, str]]
    calibrations: Sequence[tuple[bool, tuple[str, ...]]]
    boots: Sequence[Line]
    notes: Sequence[Line]
    events: Sequence[Line]


def device_page(known: Known, device: str, now: float, now_ns: int, t: Texts, told: str = "") -> DevicePage:
    """Build the present content of a known device's page, in the language of `t`.

    now: monotonic time, s. now_ns: host time, ns since the Unix epoch. told: device model that the ward file names, or
    empty.
    """
    story = known.stories[device]
    row = known.row(device, now)
    status = story.status
    in_use = status.calibration if status else ""
    shown, deaf = tile(row, story, now, now_ns, t), known.deaf(device)
    return DevicePage(
        title=f"{device}: {shown.word} · {known.ward}",
        troubles=troubles(known, t),
        tile=shown,
        placement=row.placement or Placement(),
        progress=status.progress if status else 0.0,
        guide=t("device.go_on" if _under_way(row, story) else "device.guide"),
        can_calibrate=row.state not in _UNSEEN,
        can_recalibrate=not deaf and status is not None and status.state in _RECALIBRATES,
        can_cancel=not deaf and can_cancel(status),
        blocked=t("device.blocked") if deaf else "",
        facts=_facts(story, told, t),
        calibrations=[(c.id == in_use, _calibration(c, story, t)) for c in reversed(story.calibrations.values())],
        boots=[(words.clock(b.time_ns), b.what, t.label(b.cause)) for b in reversed(story.boots.values())],
        notes=[(words.clock(n.time_ns), n.who, n.text) for n in reversed(story.notes)],
        events=[_event(mark, t) for mark in sorted(story.trail.marks, key=lambda mark: -mark.time_ns)[:20]],
    )


def _under_way(row: DeviceRow, story: Story) -> bool:
    """Return whether a person has begun to turn the device, even if no turn counts yet."""
    return row.state == "turning" or (row.state == "bias only" and failed(story))


def _calibration(c: Calibration, story: Story, t: Texts) -> tuple[str, ...]:
    """When, verdict, who, method, scale factor and bias (°/s) with 95 % intervals, turns, and reason of a calibration."""
    result = rows(c, None)
    moved = ", ".join(AXES[axis] for axis in bias_moves(c, story.calibrations.values()))
    turns = [
        t(
            "words.axis",
            axis=AXES[turn.axis],
            angle=words.signed(degrees(turn.angle), 0),
            closure=f"{degrees(turn.closure_error):.2f}",
        )
        for turn in c.turns
    ]
    return (
        words.clock(c.time_ns),
        t(f"report.{c.verdict.name.lower()}"),
        c.who,
        c.method,
        "\n".join(one.scale for one in result),
        "\n".join(one.bias for one in result),
        "\n".join(turns),
        "\n".join([t.text(c.reason), *([t("device.bias_moved", axes=moved)] if moved else [])]),
    )


def _event(mark: Mark, t: Texts) -> Line:
    return words.clock(mark.time_ns), t(f"event.{mark.kind}"), _mark_text(mark, t)


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
    """Format an accelerometer's calibration: scale factors and bias (m/s²) with 95 % intervals; empty for None.

    If the calibration is not accepted, the text gives the reason.
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
