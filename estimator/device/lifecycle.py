"""The life of a device as one table. An event the table does not name changes nothing and says so.

docs/life.md is the same table for people; a test holds the two together.
"""

from enum import StrEnum

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import State

#: no rest is this long ago: none is known of
NEVER_S = 1e9


class Event(StrEnum):
    """What can happen to a device."""

    BOOTED = "booted"
    WARM = "warm"
    RESTED = "rested"
    TURNED = "turned"
    CALIBRATED = "calibrated"
    NOT_CALIBRATED = "not_calibrated"
    RESTORED = "restored"
    CHANGED = "changed"
    RECALIBRATE = "recalibrate"
    CANCEL_TO_TRACKING = "cancel_to_tracking"
    CANCEL_TO_START = "cancel_to_start"
    DOUBTED = "doubted"
    CONFIRMED = "confirmed"
    SILENT = "silent"
    UNREACHABLE = "unreachable"
    OUTDATED = "outdated"
    HEARD = "heard"


CAUSES: dict[Event, str] = {
    Event.BOOTED: "the first sample of another boot came",
    Event.WARM: "`warming_s` are over",
    Event.RESTED: "it lay still for 2 s (people are asked for 3)",
    Event.TURNED: "a whole turn about an axis was taken",
    Event.CALIBRATED: "the turns fit together",
    Event.NOT_CALIBRATED: "they do not: some are to be repeated",
    Event.RESTORED: "the estimator was restarted, the device was not: its calibration and filter go on",
    Event.CHANGED: (
        "its model, firmware or range is another one within the boot, or the rate of a device that tells no time: "
        "its calibration is void"
    ),
    Event.RECALIBRATE: "somebody asked for new turns; the old calibration stays in force",
    Event.CANCEL_TO_TRACKING: "somebody cancelled; the old calibration stays in force",
    Event.CANCEL_TO_START: "somebody cancelled; there is no calibration of this boot",
    Event.DOUBTED: "evidence contradicts the bias, or is too old",
    Event.CONFIRMED: "a rest agrees with all of the bias again",
    Event.SILENT: "no samples for `silence_s`, or its bridge says that it is gone",
    Event.UNREACHABLE: "the estimator's router is gone: nobody knows",
    Event.OUTDATED: (
        "its bridge hears it, and all that comes was received before what was taken: "
        "a clock was set back, or a recording is played"
    ),
    Event.HEARD: "samples of the same boot came",
}


class Back:
    """Where a device was before it went away."""


S, E = State, Event
_ALIVE = (S.WARMING, S.AWAITING_STILL, S.BIAS_ONLY, S.TURNING, S.TRACKING, S.DEGRADED)
_CALIBRATING = (S.AWAITING_STILL, S.BIAS_ONLY, S.TURNING)
#: where nothing comes from it
AWAY = (S.UNKNOWN, S.LOST)
#: what may happen meanwhile, also by what came before and is learnt from later: it then goes on from elsewhere
_LEARNT = (E.RESTED, E.TURNED, E.CALIBRATED, E.NOT_CALIBRATED, E.DOUBTED, E.CONFIRMED)
_MEANWHILE = (E.CANCEL_TO_TRACKING, E.CANCEL_TO_START, E.CHANGED, *_LEARNT)

TABLE: dict[tuple[State, Event], State | type[Back]] = {
    **{(state, E.BOOTED): S.WARMING for state in State},
    **{(state, E.RESTORED): S.TRACKING for state in (S.WARMING, *_CALIBRATING)},
    **{(state, E.SILENT): S.LOST for state in (S.UNKNOWN, *_ALIVE)},
    **{(state, E.UNREACHABLE): S.UNKNOWN for state in _ALIVE},
    **{(state, E.OUTDATED): S.UNKNOWN for state in (S.LOST, *_ALIVE)},
    **{(state, E.HEARD): Back for state in AWAY},
    **{(state, E.CHANGED): S.AWAITING_STILL for state in _ALIVE if state is not S.WARMING},
    **{(state, E.RECALIBRATE): S.AWAITING_STILL for state in _ALIVE if state is not S.WARMING},
    **{(state, E.CANCEL_TO_TRACKING): S.TRACKING for state in _CALIBRATING},
    **{(state, E.CANCEL_TO_START): S.AWAITING_STILL for state in _CALIBRATING},
    (S.WARMING, E.WARM): S.AWAITING_STILL,
    (S.WARMING, E.CHANGED): S.WARMING,
    (S.AWAITING_STILL, E.RESTED): S.BIAS_ONLY,
    (S.AWAITING_STILL, E.TURNED): S.TURNING,
    (S.BIAS_ONLY, E.TURNED): S.TURNING,
    (S.BIAS_ONLY, E.CALIBRATED): S.TRACKING,  # a method that needs no full turns
    (S.TURNING, E.TURNED): S.TURNING,
    (S.TURNING, E.CALIBRATED): S.TRACKING,
    (S.TURNING, E.NOT_CALIBRATED): S.TURNING,
    (S.TRACKING, E.DOUBTED): S.DEGRADED,
    (S.DEGRADED, E.CONFIRMED): S.TRACKING,
}


class Lifecycle:
    """Where one device is, and why. One that was away goes on where it was."""

    def __init__(self) -> None:
        self.state = self._before = State.UNKNOWN
        self.reason: Sentences = (Code.NEVER_HEARD(),)
        self._reason_before: Sentences = self.reason

    @property
    def saved(self) -> tuple[str, str, Sentences, Sentences]:
        """State, the one before it went away, and the reasons of both."""
        return self.state.name, self._before.name, self.reason, self._reason_before

    def resume(self, saved: tuple[str, str, Sentences, Sentences]) -> None:
        """Go on from what was saved. Raises ValueError."""
        state, before, self.reason, self._reason_before = saved
        try:
            self.state, self._before = State[state], State[before]
        except KeyError as error:
            raise ValueError(f"damaged state: {error} is no state of a device") from None

    @property
    def away(self) -> bool:
        """Whether nothing comes from it."""
        return self.state in AWAY

    @property
    def goes_on(self) -> Sentences:
        """The reason as it is, or will be when the device is heard again."""
        return self._reason_before if self.away else self.reason

    def say(self, reason: Sentences) -> None:
        """Why it is where it is; of one that is away, where it will go on."""
        if self.away:
            self._reason_before = reason
        else:
            self.reason = reason

    def on(self, event: Event, reason: Sentences = ()) -> bool:
        """Apply an event, for a reason; False means it is not possible in this state and nothing changed."""
        meanwhile = self.away and event in _MEANWHILE
        following = TABLE.get((self._before if meanwhile else self.state, event))
        if following is Back:
            following = None if self._before is State.UNKNOWN else self._before
            reason = self._reason_before
        if not isinstance(following, State):
            return False
        if following in AWAY:
            self._reason_before, self.state = self.goes_on, following
            self.reason = reason or self.reason
            return True
        self._before = following
        if not meanwhile:
            self.state = following
        if reason:
            self.say(reason)
        return True
