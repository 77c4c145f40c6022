"""The ward page as plain values: the head, what is wrong with the ward itself, and a tile a device. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from bridge.wire.messages import State
from estimator.gyro import AXES
from estimator.ward_view import SILENT, TRACKING, UNKNOWN, URGENCY, Row, charge_it
from estimator.web import words
from estimator.web.known import Known, Story

#: what colour and shape a state has; each is told by its word too
TONES = {
    "lost": "bad",
    SILENT: "bad",
    UNKNOWN: "bad",
    "awaiting still": "ask",
    "bias only": "ask",
    "degraded": "ask",
    "turning": "busy",
    "warming": "busy",
    TRACKING: "well",
}
#: tones of devices that need a person
NEEDS = ("bad", "ask")
_CALIBRATING = (State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING)


@dataclass(frozen=True, slots=True)
class Tile:
    """One device, in words that can be shown as they are; the numbers are for sorting, None last."""

    id: str
    number: int
    state: str
    tone: str
    needs: bool
    reason: str
    notices: str
    quality: str
    bias: str
    calibrated: str
    rest: str
    rate: str
    gaps: str
    battery: str
    battery_low: bool
    temperature: str
    turns: str
    rebooted: str
    bias_std: float | None
    calibrated_ns: int | None
    battery_percent: float | None


@dataclass(frozen=True, slots=True)
class WardPage:
    """Everything the ward page shows. `troubles` are of the ward itself; `counts` how many are in which state."""

    ward: str
    time_ns: int
    connected: bool
    tracking: int
    of: int
    counts: Sequence[tuple[str, str, int]]
    troubles: Sequence[str]
    tiles: Sequence[Tile]


def ward_page(known: Known, now: float, now_ns: int) -> WardPage:
    """What is to be shown now: `now` in seconds of the clock messages were heard by, now_ns of the wall's."""
    rows = known.rows(now)
    tiles = [tile(row, known.stories[row.device], now_ns) for row in rows]
    counts = [(state, TONES[state], sum(row.state == state for row in rows)) for state in URGENCY]
    return WardPage(
        ward=known.ward,
        time_ns=now_ns,
        connected=known.connected,
        tracking=sum(row.state == TRACKING for row in rows),
        of=len(rows),
        counts=[count for count in counts if count[2]],
        troubles=troubles(known),
        tiles=tiles,
    )


def troubles(known: Known) -> list[str]:
    """What is wrong with the ward itself, in words; while there is no router nothing else can be known."""
    if not known.connected:
        return ["The ward's router is not there: nothing is heard, and what is shown is what was known last."]
    seen = known.glance()
    found = [f"{words[:1].upper()}{words[1:]}." for words in seen.troubles]
    found += [f"{device}: samples are not accounted for: {words}." for device, words in seen.law.items()]
    if left_out := known.left_out.as_dict().get("devices"):
        found.append(f"There are too many devices: {left_out} messages of further ones are left out.")
    return found


def tile(row: Row, story: Story, now_ns: int) -> Tile:
    """One device."""
    status, info = story.status, story.info
    told_hz, measured_hz = (info.rate_hz, info.measured_rate_hz) if info else (0.0, 0.0)
    calibrated_ns = status.calibrated_time_ns if status else 0
    calibrating = status is not None and status.state in _CALIBRATING
    tone = "ask" if row.low_battery and TONES[row.state] not in NEEDS else TONES[row.state]
    notices = [charge_it(row.battery_percent)] if row.low_battery and row.battery_percent is not None else []
    notices += [f"{name}: {said}" for name, said in row.notices.items()]
    return Tile(
        id=row.device,
        number=story.number,
        state=row.state,
        tone=tone,
        needs=tone in NEEDS,
        reason=row.reason,
        notices="; ".join(notices),
        quality=row.quality,
        bias=words.bias(status.bias, status.bias_std) if status and row.quality != "none" else "",
        calibrated=words.ago(calibrated_ns, now_ns) if calibrated_ns else "not since it started" if status else "",
        rest=words.ago(now_ns - round(row.evidence_age_s * 1e9), now_ns) if row.evidence_age_s is not None else "",
        rate=words.rate(measured_hz or row.rate_hz, told_hz),
        gaps=words.gaps(row.gaps, row.missing_samples) if status else "",
        battery=words.battery(row.battery_percent, charging=row.charging),
        battery_low=row.low_battery,
        temperature=words.temperature(status.temperature_c) if status else "",
        turns="".join(AXES[axis] if axis in status.axes_done else "·" for axis in range(3))
        if status and calibrating
        else "",
        rebooted=_rebooted(story, now_ns) if row.state != TRACKING else "",
        bias_std=max(status.bias_std) if status else None,
        calibrated_ns=calibrated_ns or None,
        battery_percent=row.battery_percent,
    )


def _rebooted(story: Story, now_ns: int) -> str:
    """That it has started anew and must be calibrated again; nothing of a device's first boot."""
    if not rebooted(story):
        return ""
    boot = story.boots[story.boot]
    cause = f", {boot.cause}" if boot.cause else ""
    return f"started again {words.ago(boot.time_ns, now_ns)}{cause}: it must be calibrated again"


def rebooted(story: Story) -> bool:
    """Whether it has started anew while somebody listened, and was not calibrated since."""
    calibrated = story.status is not None and story.status.calibrated_time_ns
    return len(story.boots) > 1 and story.boot in story.boots and not calibrated
