"""Content of the guide page as plain values in every language. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, degrees, isfinite

from bridge.wire.messages import Calibration, State, Status
from estimator.geometry.gyro_model import AXES
from estimator.guide.comparison import compared, differing, last_before
from estimator.guide.guide import CALIBRATING, SIDES
from estimator.guide.hand_motion import Hand
from estimator.guide.steps import Instruction, Picture, Step, Words
from estimator.language.texts import LANGUAGES, Texts, texts
from estimator.overview.ward import to_calibrate
from estimator.web import number_format
from estimator.web.tiles import troubles
from estimator.web.ward_state import Known

_RESTS = (Step.PLACE, Step.SETTLE)
_OVER = (Step.IDLE, Step.DONE, Step.CANCELLED)
_RECALIBRATES = (State.TRACKING, State.DEGRADED)
_REST_S = Hand().rest_s


@dataclass(frozen=True, slots=True)
class Turn:
    """Item in the guide page's list of tasks: a turn about an axis, or a side of the device to rest it on.

    picture: name of the drawing. mark: done, now (in progress) or next. how: instruction, or empty. state: `mark` in
    the reader's language.
    """

    axis: str
    picture: str
    mark: str  # done, now or next
    how: str
    state: str


@dataclass(frozen=True, slots=True)
class Said:
    """Texts of the guide page in one language; an empty text is not shown.

    head, how: what to do, and how. wrong: why the last attempt was not accepted. compared: comparison with the previous
    calibration. troubles: faults of the ward.
    """

    head: str
    how: str
    wrong: Sequence[str]
    rebooted: str
    progress: str
    turns: Sequence[Turn]
    compared: str
    troubles: Sequence[str]


@dataclass(frozen=True, slots=True)
class Axis:
    """Row of the result table for one axis, as texts with 95 % intervals.

    scale: scale factor. before: scale factor of the previous accepted calibration, or empty. bias: bias, °/s.
    """

    axis: str
    scale: str
    before: str
    bias: str


@dataclass(frozen=True, slots=True)
class GuideView:
    """Content of a device's guide page, with its texts in each language.

    tone: colour class. percent: fill of the progress ring, 0 to 100. centre: the text inside the ring.
    way: sign of the angle of the present turn about its axis, 1 or -1; 0 if no turn is in progress.
    calibration: id of the resulting calibration, or empty. following: id of the next device to calibrate, once this one
    is finished.
    say: texts by language.
    """

    device: str
    step: str
    tone: str
    picture: str
    way: int
    percent: int
    centre: str
    can_begin: bool
    can_cancel: bool
    calibration: str
    following: str
    result: Sequence[Axis]
    say: Mapping[str, Said]


def guide_view(told: Instruction, known: Known, device: str, now: float) -> GuideView:
    """Build the present content of the guide page of a device, from the guide's instruction.

    told: the instruction. known: collected messages of the ward, which include the device. now: monotonic time, s.
    """
    story = known.stories[device]
    status = story.status
    deaf, told = known.deaf(device), unless_broken(told, known, device, now)
    calibration = story.calibrations.get(status.calibration) if status and told.step in _OVER else None
    before = None if calibration is None else last_before(calibration, story.calibrations.values())
    return GuideView(
        device=device,
        step=told.step,
        tone=_tone(told),
        picture=told.picture,
        way=(told.angle > 0) - (told.angle < 0) if told.step is Step.TURNING and told.axis is not None else 0,
        percent=round(100 * told.ring),
        centre=_centre(told),
        can_begin=not deaf and status is not None and status.state in _RECALIBRATES,
        can_cancel=not deaf and can_cancel(status),
        calibration=calibration.id if calibration else "",
        following=_following(known, device, now) if told.picture is Picture.WELL else "",
        result=rows(calibration, before) if calibration else (),
        say={name: _said(told, known, calibration, before, texts(name)) for name in LANGUAGES},
    )


def can_cancel(status: Status | None) -> bool:
    """Return whether a calibration runs that can be cancelled: turns are done, or an earlier calibration stays in use.

    status: of the device, None if unknown.
    """
    return status is not None and status.state in CALIBRATING and bool(status.axes_done or status.calibrated_time_ns)


def _following(known: Known, device: str, now: float) -> str:
    """The next device of the ward that waits for turns by hand; empty where none does."""
    return next((other for other in to_calibrate(known.rows(now)) if other != device), "")


def unless_broken(told: Instruction, known: Known, device: str, now: float) -> Instruction:
    """Return the instruction `told`, or one with step BROKEN if a fault of the ward stops the device's samples.

    Such a fault is a missing router, estimator or bridge. known: collected messages of the ward. now: monotonic time,
    s.
    """
    if not known.broken(device, now):
        return told
    return Instruction(Step.BROKEN, Picture.NOTHING, Words("broken"), rebooted=told.rebooted)


def rows(calibration: Calibration, before: Calibration | None) -> list[Axis]:
    """Return the result table of a calibration: for each axis scale factor, previous scale factor, and bias.

    before: previous accepted calibration of the device; None if there is none.
    """
    return [
        Axis(
            AXES[one.axis],
            number_format.interval(one.scale, one.scale_std, 4),
            number_format.interval(one.before, one.before_std, 4) if isfinite(one.before) else "",
            number_format.interval(degrees(one.bias), degrees(one.bias_std), 3),
        )
        for one in compared(calibration, before)
    ]


def against(calibration: Calibration, before: Calibration | None, t: Texts) -> str:
    """Return a sentence that compares two calibrations of a device, naming the axes whose scale factors differ.

    Scale factors differ if they are over 3 standard deviations of the difference apart. before: previous accepted
    calibration; None if there is none, which the sentence then states.
    """
    if before is None:
        return t("guide.first")
    axes = ", ".join(AXES[axis] for axis in differing(compared(calibration, before)))
    return t(f"guide.{'differs' if axes else 'same'}", when=number_format.clock(before.time_ns), axes=axes)


def _said(
    told: Instruction, known: Known, calibration: Calibration | None, before: Calibration | None, t: Texts
) -> Said:
    percent, angle = round(100 * told.ring), f"{abs(degrees(told.angle)):.0f}°"
    progress = {Step.TURNING: t("guide.turned", angle=angle), Step.TURN: t("guide.turned", angle="0°")}
    progress[Step.POSE] = t("guide.sides", seen=len(told.sides or ()))
    progress |= dict.fromkeys(_RESTS, t("guide.rest", percent=percent))
    return Said(
        head=t.say("head", told.head),
        how=t(f"how.{told.how}"),
        wrong=[t.text((one,)) for one in told.wrong],
        rebooted=t("guide.rebooted") if told.rebooted else "",
        progress=progress.get(told.step, ""),
        turns=_turns(told, t),
        compared=against(calibration, before, t) if calibration else "",
        troubles=troubles(known, t),
    )


def _turns(told: Instruction, t: Texts) -> list[Turn]:
    found = []
    turning = told.step in (Step.TURN, Step.STAND, Step.TURNING, Step.SETTLE)
    if told.sides is not None and told.step not in _OVER:
        return [_side(side, told.sides, t) for side in range(SIDES)]
    for axis in (*told.done, *told.needed):
        mark = "done" if axis in told.done else "now" if turning and axis == told.axis else "next"
        picture = told.ways[axis]
        # How an earlier calibration was made is unknown: only the posture at that time could show it.
        how = "" if told.step is Step.IDLE or told.sides is not None else t(f"guide.{picture}")
        found.append(Turn(AXES[axis], picture, mark, how, t(f"guide.{mark}")))
    return sorted(found, key=lambda turn: (bool(turn.how) and turn.picture != Picture.FLAT, turn.axis))


def _side(side: int, seen: Sequence[int], t: Texts) -> Turn:
    """One of the six sides to rest on."""
    mark, way = "done" if side in seen else "next", "down" if side % 2 else "up"
    return Turn(AXES[side // 2], Picture.POSE, mark, t(f"guide.{way}"), t(f"guide.{mark}"))


def _tone(told: Instruction) -> str:
    if told.step in (Step.AWAY, Step.BROKEN, Step.REFUSED):
        return "bad"
    if told.step in _OVER:
        return "well" if told.picture is Picture.WELL else "ask"
    return "ask" if told.wrong else "busy"


def _centre(told: Instruction) -> str:
    """Text inside the ring: seconds left, degrees turned, or sides seen."""
    if told.step in _RESTS:
        return "✓" if told.ring >= 1 else f"{ceil((1 - told.ring) * _REST_S)} s"
    if told.step in (Step.TURN, Step.TURNING):
        return f"{abs(degrees(told.angle)):.0f}°"
    if told.step is Step.POSE:
        return f"{len(told.sides or ())}/{SIDES}"
    return ""
