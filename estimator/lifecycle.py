"""The life of a device as one table. An event the table does not name changes nothing and says so."""

from enum import StrEnum

from bridge.wire.messages import State


class Event(StrEnum):
    """What can happen to a device."""

    BOOTED = "booted"
    WARM = "warm"
    RESTED = "rested"
    TURNED = "turned"
    CALIBRATED = "calibrated"
    RESTORED = "restored"
    NOT_CALIBRATED = "not_calibrated"
    RECALIBRATE = "recalibrate"
    CANCEL_TO_TRACKING = "cancel_to_tracking"
    CANCEL_TO_START = "cancel_to_start"
    DOUBTED = "doubted"
    CONFIRMED = "confirmed"
    SILENT = "silent"


S, E = State, Event
_ALIVE = (S.WARMING, S.AWAITING_STILL, S.BIAS_ONLY, S.TURNING, S.TRACKING, S.DEGRADED)
_CALIBRATING = (S.AWAITING_STILL, S.BIAS_ONLY, S.TURNING)

TABLE: dict[tuple[State, Event], State] = {
    **{(state, E.BOOTED): S.WARMING for state in State},
    **{(state, E.RESTORED): S.TRACKING for state in (S.WARMING, *_CALIBRATING)},
    **{(state, E.SILENT): S.LOST for state in _ALIVE},
    **{(state, E.RECALIBRATE): S.AWAITING_STILL for state in _ALIVE if state is not S.WARMING},
    **{(state, E.CANCEL_TO_TRACKING): S.TRACKING for state in _CALIBRATING},
    **{(state, E.CANCEL_TO_START): S.AWAITING_STILL for state in _CALIBRATING},
    (S.WARMING, E.WARM): S.AWAITING_STILL,
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


class Life:
    """Where one device is. A lost device that is heard again goes on where it was."""

    def __init__(self) -> None:
        self.state = State.UNKNOWN
        self._before_lost = State.UNKNOWN

    def on(self, event: Event) -> bool:
        """Apply an event; False means it is not possible in this state and nothing changed."""
        following = TABLE.get((self.state, event))
        if following is None:
            return False
        if following is State.LOST:
            self._before_lost = self.state
        self.state = following
        return True

    def heard(self) -> bool:
        """Samples of the same boot came again; True when the device had been lost."""
        if self.state is not State.LOST:
            return False
        self.state = self._before_lost
        return True
