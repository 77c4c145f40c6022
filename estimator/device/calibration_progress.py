"""A calibration in progress: who asked for it, which turns are done, and what is left to do."""

from bridge.reasons.codes import Code, Sentences
from estimator.calibration.clipping import ClippingKnobs
from estimator.calibration.session import CalibrationSession, too_old
from estimator.calibration.session_events import Expired, Ignored, Progress, TurnFound
from estimator.calibration.turn_recognition import TurnKnobs
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import AXES, axis_names
from estimator.stillness.detector import Windows


def turn_knobs(knobs: SessionKnobs, gyro_range: float = 0.0) -> TurnKnobs:
    """What counts as a full turn of a device; gyro_range in rad/s as told of this recording, 0 where nothing was."""
    clipping = ClippingKnobs(gyro_range=gyro_range or knobs.gyro_range)
    return TurnKnobs(horizontal=knobs.horizontal_turns, clipping=clipping)


class CalibrationProgress:
    """Windows in, progress out. `who` asked for it and `why`; nobody, where a device has just booted."""

    def __init__(self, knobs: SessionKnobs, who: str = "", why: str = "") -> None:
        self._capture = CalibrationSession(knobs.method, turn_knobs=turn_knobs(knobs), scale_limit=knobs.scale_limit)
        self.who, self.why = who, why

    @property
    def asked(self) -> tuple[str, str] | None:
        """Who asked for it, and why; None where nobody did."""
        return (self.who, self.why) if self.who else None

    @property
    def awaited(self) -> bool:
        """Whether somebody waits for what the next samples show: its first rest, or a turn after another."""
        return bool(self.turned) or not self._capture.rested

    @property
    def near(self) -> bool:
        """Whether what comes next may end it, which takes as long as hundreds of batches."""
        return self._capture.near

    @property
    def turned(self) -> tuple[int, ...]:
        """Axes whose turns are taken."""
        return self._capture.done()

    @property
    def missing(self) -> str:
        """Axes whose turns are still needed."""
        return axis_names(self._capture.missing())

    def add(self, windows: Windows) -> None:
        """Take the samples of the next windows, and nothing more."""
        _, rows = windows.samples
        self._capture.take(rows)

    def judge(self, begun: float, ended: float, *, still: bool) -> list[Progress]:
        """Judge what the next window whose samples were taken completes, from when to when, s."""
        old = self._capture.expire(ended)
        progress = self._capture.judge(begun, ended, still=still)
        return [Expired(old), *progress] if old else progress

    def said(self, progress: TurnFound | Expired | Ignored) -> Sentences:
        """What is said of it, and of what is still to be done."""
        missing = self._capture.missing()
        match progress:
            case TurnFound(turn, dropped, missing):
                what: Sentences = (Code.TURN_TAKEN(axis=AXES[turn.axis]), *dropped.values())
            case Expired(axes):
                what = (too_old(axes),)
            case Ignored(no_turn):
                what = no_turn.reason
        return (*what, Code.TURNS_NEEDED(axes=axis_names(missing))) if missing else what
