"""A calibration in progress: who asked for it, which turns are done, and which are missing."""

from bridge.reasons.codes import Code, Sentences
from estimator.calibration.session import CalibrationSession, too_old
from estimator.calibration.session_events import Expired, Ignored, Progress, TurnFound
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import AXES, axis_names


class CalibrationProgress(CalibrationSession):
    """Calibration in progress, and its sentences for people.

    who, why: the person who asked for it and the reason; empty for the calibration after a boot.
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
        """Who asked for the calibration, and why; None for the one that every boot begins with."""
        return (self.who, self.why) if self.who else None

    @property
    def awaited(self) -> bool:
        """True if a person now waits for a result of the next samples: the first rest, or a turn after another."""
        return bool(self.turns) or not self.rested

    def judge(self, begun: float, ended: float, *, still: bool) -> list[Progress]:
        """Judge the next window as a calibration session does; the events also name turns that are now too old.

        begun, ended: device time of the window, s. still: whether the window was judged still.
        """
        old = self.expire(ended)
        progress = super().judge(begun, ended, still=still)
        return [Expired(old), *progress] if old else progress

    def said(self, progress: TurnFound | Expired | Ignored) -> Sentences:
        """Return sentences for people about an event of the calibration, and about the turns still needed."""
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
