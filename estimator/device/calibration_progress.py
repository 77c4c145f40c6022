"""Calibration in progress: its requester, completed and missing turns, and messages for people."""

from bridge.reasons.codes import Code, Sentences
from estimator.calibration.session import CalibrationSession, too_old
from estimator.calibration.session_events import Expired, Ignored, Progress, TurnFound
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import AXES, axis_names


class CalibrationProgress(CalibrationSession):
    """Calibration session in progress, with its requester and its messages for people.

    who, why: the person who requested it and the reason; both empty for the calibration that follows a boot.
    """

    def __init__(self, knobs: SessionKnobs, who: str = "", why: str = "") -> None:
        super().__init__(
            knobs.method,
            gyro_range=knobs.gyro_range,
            horizontal=knobs.horizontal_turns,
            scale_limit=knobs.scale_limit,
        )
        self.who, self.why = who, why
        #: reason of the last verdict that refused, which stays while turns are repeated
        self.refused: Sentences = ()

    @property
    def asked(self) -> tuple[str, str] | None:
        """Name of the person who requested the calibration, and the reason.

        None for the calibration that follows a boot.
        """
        return (self.who, self.why) if self.who else None

    @property
    def awaited(self) -> bool:
        """True while a person waits for a result: until the first rest is found, and from the first turn on."""
        return bool(self.turns) or not self.rested

    def judge(self, begun: float, ended: float, *, still: bool) -> list[Progress]:
        """Process a window of the stillness detector; return its events, such as turns that have become too old.

        Windows must come in the order of time. begun, ended: device time of the start and end of the window, s. still:
        whether the device was still in the window.
        """
        old = self.expire(ended)
        progress = super().judge(begun, ended, still=still)
        return [Expired(old), *progress] if old else progress

    def said(self, progress: TurnFound | Expired | Ignored) -> Sentences:
        """Return messages for people about an event of the calibration, followed by the turns still needed."""
        missing = self.missing()
        match progress:
            case TurnFound(turn, dropped, missing):
                what: Sentences = (Code.TURN_TAKEN(axis=AXES[turn.axis]), *dropped.values())
            case Expired(axes):
                what = (too_old(axes),)
            case Ignored(no_turn):
                what = no_turn.reason
        needed = (Code.TURNS_NEEDED(axes=axis_names(missing)),) if missing else ()
        return (*what, *needed, *(one for one in self.refused if one not in what))
