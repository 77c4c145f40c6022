"""Content of the ward page as plain values: numbers of devices, faults of the ward, and one tile per device. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Alert, Placement
from estimator.alerts.outbox import sentence
from estimator.geometry.gyro_model import AXES
from estimator.guide.guide import CALIBRATING, wrong_in
from estimator.language.texts import Texts
from estimator.overview.ward import ENDED, SILENT, TRACKING, UNKNOWN, URGENCY, DeviceRow, to_calibrate
from estimator.web import number_format
from estimator.web.ward_state import Known, Story

#: tone of each state, which gives colour and shape; the state's word is shown as well
TONES = {
    "lost": "bad",
    SILENT: "bad",
    UNKNOWN: "bad",
    "awaiting still": "ask",
    "bias only": "ask",
    "degraded": "ask",
    "turning": "ask",
    "warming": "busy",
    TRACKING: "well",
    ENDED: "busy",
}
#: states in which the next thing to do is to turn the device
_BY_HAND = ("awaiting still", "bias only", "turning")
#: reasons that only give the same order as the advice, in other words
_ORDERS = frozenset({Code.HOLD_STILL, Code.TURN_NOW, Code.RESTARTED})


@dataclass(frozen=True, slots=True)
class Tile:
    """Tile of one device: texts in one language, and at the end three numbers for sorting, of which None sorts last.

    state: name for programs. word: name for people. tone: colour class. advice: one plain sentence that says what to
    do.
    number: index of the device in the binary frames that cover all devices.
    bias_std: standard deviation of the bias on the least known axis, rad/s. calibrated_ns: host time of the
    calibration, ns since the Unix epoch.
    battery_percent: charge, 0 to 100.
    """

    id: str
    number: int
    state: str
    word: str
    tone: str
    needs: bool
    advice: str
    reason: str
    notices: str
    placement: str
    quality: str
    bias: str
    calibrated: str
    rest: str
    rate: str
    gaps: str
    battery: str
    temperature: str
    turns: str
    rebooted: str
    stale: str
    calibrate: str
    bias_std: float | None
    calibrated_ns: int | None
    battery_percent: float | None


@dataclass(frozen=True, slots=True)
class AlertLine:
    """Standing alert (raised and not yet cleared) as text.

    subject: id of the device or estimator. since: time since the start of the fault. seen: who acknowledged the alert,
    or empty.
    """

    subject: str
    kind: str
    words: str
    since: str
    seen: str


@dataclass(frozen=True, slots=True)
class WardPage:
    """Content of the ward page.

    alarm: whether an alert is not yet acknowledged, outside quiet hours. troubles: faults of the ward itself.
    queue: ids of devices that wait for turns by hand. of: number of devices.
    counts: for each state its name, colour class, number of devices, and name for people.
    """

    count: str
    title: str
    of: int
    counts: Sequence[tuple[str, str, int, str]]
    troubles: Sequence[str]
    alerts: Sequence[AlertLine]
    alarm: bool
    queue: Sequence[str]
    tiles: Sequence[Tile]


def ward_page(known: Known, now: float, now_ns: int, t: Texts) -> WardPage:
    """Build the present content of the ward page, in the language of `t`.

    now: monotonic time, s. now_ns: host time, ns since the Unix epoch.
    """
    quiet = known.alert_settings.quiet(datetime.fromtimestamp(now_ns / 1e9).astimezone())
    alerts = [_alert(*one, now_ns, t) for one in known.alerts(now)]
    rows = known.rows(now)
    tiles = [tile(row, known.stories[row.device], now, now_ns, t) for row in rows]
    counts = [(state, TONES[state], sum(row.state == state for row in rows), word(state, t)) for state in URGENCY]
    tracking = sum(row.state == TRACKING for row in rows)
    count = t("ward.count", tracking=tracking, of=len(rows))
    return WardPage(
        count=count,
        title=f"{t('ward.tracking', count=count)} · {known.ward}",
        of=len(rows),
        counts=counts,
        troubles=troubles(known, t),
        alerts=alerts,
        alarm=any(not one.seen for one in alerts) and not quiet,
        queue=to_calibrate(rows),
        tiles=tiles,
    )


def _alert(subject: str, placement: Placement | None, alert: Alert, now_ns: int, t: Texts) -> AlertLine:
    where = worn(placement, t)
    return AlertLine(
        subject=subject,
        kind=alert.kind,
        words=t.text((sentence(alert.kind, f"{subject} ({where})" if where else subject),)),
        since=number_format.ago(alert.since_ns, now_ns, t),
        seen=t("alert.seen", who=alert.who) if alert.acknowledged_ns else "",
    )


def word(state: str, t: Texts) -> str:
    """Return the name of a device's state for people, in the language of `t`."""
    return t(f"state.{state.replace(' ', '_')}")


def troubles(known: Known, t: Texts) -> list[str]:
    """Return the faults of the ward itself (not of single devices) as sentences in the language of `t`."""
    return [t.text((trouble,)) for trouble in known.troubles()]


def tile(row: DeviceRow, story: Story, now: float, now_ns: int, t: Texts) -> Tile:
    """Build the tile of one device, in the language of `t`.

    row: its row in the ward summary. story: its collected messages. now: monotonic time, s. now_ns: host time, ns since
    the Unix epoch.
    """
    status, info = story.status, story.info
    told_hz, measured_hz = (info.rate_hz, info.measured_rate_hz) if info else (0.0, 0.0)
    calibrated_ns = status.calibrated_time_ns if status else 0
    calibrating = status is not None and status.state in CALIBRATING
    return Tile(
        id=row.device,
        number=story.number,
        state=row.state,
        word=word(row.state, t),
        tone=toned(row),
        needs=row.needs_person,
        advice=advice(row, story, t),
        reason=t.text(explained(row.reason)),
        notices=t.text(row.notices),
        placement=worn(row.placement, t),
        quality=t(f"quality.{row.quality.replace(' ', '_')}") if row.quality else "",
        bias=number_format.bias(status.bias, status.bias_std) if status and row.quality != "none" else "",
        calibrated=number_format.ago(calibrated_ns, now_ns, t)
        if calibrated_ns
        else t("words.uncalibrated")
        if status
        else "",
        rest=_rest(row, now_ns, t) if status else "",
        rate=number_format.rate(measured_hz or row.rate_hz, told_hz, t),
        gaps=number_format.gaps(row.gaps, row.missing_samples, t) if status else "",
        battery=number_format.battery(row.battery_percent, t, charging=row.charging),
        temperature=number_format.temperature(status.temperature_c) if status else "",
        turns=t("words.turned", axes=", ".join(AXES[axis] for axis in status.axes_done))
        if status and calibrating and status.axes_done
        else "",
        rebooted=_rebooted(story, now_ns, t) if row.state != TRACKING else "",
        stale=_stale(row, story, now, t),
        calibrate=t("ward.calibrate") if row.state in _BY_HAND else "",
        bias_std=max(status.bias_std) if status else None,
        calibrated_ns=calibrated_ns or None,
        battery_percent=row.battery_percent,
    )


def worn(placement: Placement | None, t: Texts) -> str:
    """Format a placement: `upper arm, left · bed-3`; empty if nobody wears the device, or no placement is recorded."""
    if not placement:
        return ""
    where = t(f"placement.{placement.segment}") if placement.segment else ""
    side = t(f"placement.{placement.side}") if placement.side else ""
    return " · ".join(filter(None, (t("placement.sided", where=where, side=side) if side else where, placement.wearer)))


def toned(row: DeviceRow) -> str:
    """Return the colour class of a device: bad, ask (needs a person), busy or well.

    A device that needs a person is never busy or well.
    """
    return "ask" if row.needs_person and TONES[row.state] in ("busy", "well") else TONES[row.state]


def advice(row: DeviceRow, story: Story, t: Texts) -> str:
    """Return one plain sentence that says what a person is to do with the device, in the language of `t`."""
    key, done = row.state.replace(" ", "_"), len(story.status.axes_done) if story.status else 0
    if row.state == TRACKING and row.needs_person:
        key = "charge" if row.low_battery else "bad_samples"
    elif row.state in ("bias only", "turning") and failed(story):
        key = "again"
    elif row.state in ("awaiting still", "bias only") and rebooted(story):
        key = "rebooted"
    return t(f"tile.{key}", done=done)


def failed(story: Story) -> bool:
    """Return whether the last turn of a device does not count, so that it has to be repeated."""
    return story.status is not None and bool(wrong_in(story.status.reason))


def explained(reason: Sentences) -> Sentences:
    """Return the sentences of `reason` that do not tell a person what to do; `advice` says that once for the page."""
    return tuple(one for one in reason if one.code not in _ORDERS)


def _rest(row: DeviceRow, now_ns: int, t: Texts) -> str:
    age_s = row.evidence_age_s
    return t("words.no_rest") if age_s is None else number_format.ago(now_ns - round(age_s * 1e9), now_ns, t)


def _rebooted(story: Story, now_ns: int, t: Texts) -> str:
    """Notice that a device rebooted and needs a new calibration; empty for a device's first boot."""
    if not rebooted(story):
        return ""
    boot = story.boots[story.boot]
    ago = number_format.ago(boot.time_ns, now_ns, t)
    return t("words.rebooted_by", ago=ago, cause=t.label(boot.cause)) if boot.cause else t("words.rebooted", ago=ago)


def _stale(row: DeviceRow, story: Story, now: float, t: Texts) -> str:
    """Age of the numbers, where they are not current; else empty."""
    if row.state not in ("lost", SILENT, UNKNOWN) or story.heard_s is None:
        return ""
    return t("words.as_of", ago=t("words.ago", age=number_format.lasting(now - story.heard_s, t)))


def rebooted(story: Story) -> bool:
    """Return whether a device's present boot is not its first known one, and has no calibration yet."""
    calibrated = story.status is not None and story.status.calibrated_time_ns
    return len(story.boots) > 1 and story.boot in story.boots and not calibrated
