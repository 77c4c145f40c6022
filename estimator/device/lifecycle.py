"""Life cycle of a device as one state table. An event that the table does not list for a state changes nothing.

docs/life.md shows the same table for people; a test compares the two.
"""

from enum import StrEnum

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import State

#: s; an evidence age beyond every real one, for a device without a known rest
NEVER_S = 1e9


class Event(StrEnum):
    """Event in the life of a device; `CAUSES` says when each occurs."""

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
    Event.BOOTED: "the first sample of another boot arrived",
    Event.WARM: "the device has been on for `warming_s` seconds",
    Event.RESTED: "the device lay still for 2 s (the instructions ask for 3 s)",
    Event.TURNED: "a full turn about an axis was accepted",
    Event.CALIBRATED: "the three turns agree with each other",
    Event.NOT_CALIBRATED: "the turns contradict each other: some turns must be repeated",
    Event.RESTORED: (
        "the estimator was restarted but the device was not, so calibration and filter continue; or the device "
        "reported a calibration of its own"
    ),
    Event.CHANGED: (
        "model, firmware or full-scale range changed within the boot, or the output data rate of a device without a "
        "clock; the calibration becomes invalid"
    ),
    Event.RECALIBRATE: "a person or program requested new turns; the old calibration stays in force",
    Event.CANCEL_TO_TRACKING: "the request for new turns was cancelled; the old calibration stays in force",
    Event.CANCEL_TO_START: "the request for new turns was cancelled; this boot has no calibration",
    Event.DOUBTED: "measurements contradict the tracked bias, or the last measurement of the bias is too old",
    Event.CONFIRMED: "a rest agrees with the bias on every axis again",
    Event.SILENT: "no samples for `silence_s`, or the bridge reports the device as gone",
    Event.UNREACHABLE: "the estimator has no connection to a router, so the state is unknown",
    Event.OUTDATED: (
        "all new samples are older than samples already accepted: the clock of the bridge's host was set back, or a "
        "recording is played"
    ),
    Event.HEARD: "samples of the same boot arrived",
}


class Back:
    """Entry of the state table that means: return to the state from before the device went away."""


S, E = State, Event
_ALIVE = (S.WARMING, S.AWAITING_STILL, S.BIAS_ONLY, S.TURNING, S.TRACKING, S.DEGRADED)
_CALIBRATING = (S.AWAITING_STILL, S.BIAS_ONLY, S.TURNING)
#: states of a device from which nothing arrives
AWAY = (S.UNKNOWN, S.LOST)
#: events possible while a device is away, also from samples that came before; they change the state it will return to
_LEARNT = (E.RESTED, E.TURNED, E.CALIBRATED, E.NOT_CALIBRATED, E.DOUBTED, E.CONFIRMED)
_MEANWHILE = (E.CANCEL_TO_TRACKING, E.CANCEL_TO_START, E.CHANGED, E.RESTORED, *_LEARNT)

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
    (S.BIAS_ONLY, E.CALIBRATED): S.TRACKING,  # by a method without full turns
    (S.TURNING, E.TURNED): S.TURNING,
    (S.TURNING, E.CALIBRATED): S.TRACKING,
    (S.TURNING, E.NOT_CALIBRATED): S.TURNING,
    (S.TRACKING, E.DOUBTED): S.DEGRADED,
    (S.DEGRADED, E.CONFIRMED): S.TRACKING,
}


class Lifecycle:
    """State machine of one device: present state, and the reasons for it.

    A device that goes away and is heard again returns to its earlier state.
    """

    def __init__(self) -> None:
        self.state = self._before = State.UNKNOWN
        self.reason: Sentences = (Code.NEVER_HEARD(),)
        self._reason_before: Sentences = self.reason

    @property
    def saved(self) -> tuple[str, str, Sentences, Sentences]:
        """State to save for `resume`.

        Names of the present state and of the state before the device went away, then the reasons of both.
        """
        return self.state.name, self._before.name, self.reason, self._reason_before

    def resume(self, saved: tuple[str, str, Sentences, Sentences]) -> None:
        """Restore a state saved by `saved`. Raises ValueError if it names an unknown state."""
        state, before, self.reason, self._reason_before = saved
        try:
            self.state, self._before = State[state], State[before]
        except KeyError as error:
            raise ValueError(f"damaged state: unknown device state {error}; start without this state") from None

    @property
    def away(self) -> bool:
        """True if nothing arrives from the device: state UNKNOWN or LOST."""
        return self.state in AWAY

    @property
    def goes_on(self) -> Sentences:
        """Reason of the present state; while the device is away, reason of the state to which it will return."""
        return self._reason_before if self.away else self.reason

    def say(self, reason: Sentences) -> None:
        """Set the reason of the present state; while the device is away, of the state to which it will return."""
        if self.away:
            self._reason_before = reason
        else:
            self.reason = reason

    def on(self, event: Event, reason: Sentences = ()) -> bool:
        """Change the state as the state table lists it for an event; set the reason for the new state.

        Returns whether the table lists the event for this state; if not, nothing has changed. An empty reason keeps the
        present one.
        """
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
