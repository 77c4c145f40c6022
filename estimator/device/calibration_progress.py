"""A calibration in progress: who asked for it, which turns are done, and which are missing."""

from bridge.reasons.codes import Code, Sentences
from estimator.calibration.session import CalibrationSession, too_old
from estimator.calibration.session_events import Expired, Ignored, Progress, TurnFound
from estimator.device.session_knobs import SessionKnobs
from estimator.geometry.gyro_model import AXES, axis_names
from estimator.stillness.detector import Windows


class CalibrationProgress:
    """Calibration in progress: windows in, events of the calibration session out.

    who, why: the person who asked for it and the reason; empty for the calibration after a boot.
    """

    def __init__(self, knobs: SessionKnobs, who: str = "", why: str = "") -> None:
        self._capture = CalibrationSession(
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
        """Whether a person now waits for a result of the next samples: the first rest, or a turn after another."""
        return bool(self.turned) or not self._capture.rested

    @property
    def turned(self) -> tuple[int, ...]:
        """Axes whose turns are taken (0 to 2)."""
        return self._capture.done()

    @property
    def missing(self) -> str:
        """Names of the axes whose turns are still needed, such as `x, z`."""
        return axis_names(self._capture.missing())

    def add(self, windows: Windows) -> None:
        """Store the samples of the next windows without judging them."""
        _, rows = windows.samples
        self._capture.take(rows)

    def judge(self, begun: float, ended: float, *, still: bool) -> list[Progress]:
        """Judge the next window, from device time `begun` to `ended`, s; its samples were stored by `add` before.

        still: whether the window was judged still. Returns the events it completes, and turns that are now too old.
        """
        old = self._capture.expire(ended)
        progress = self._capture.judge(begun, ended, still=still)
        return [Expired(old), *progress] if old else progress

    def said(self, progress: TurnFound | Expired | Ignored) -> Sentences:
        """Text for people about an event of the calibration, and about the turns still needed."""
        missing = self._capture.missing()
        match progress:
            case TurnFound(turn, dropped, missing):
                what: Sentences = (Code.TURN_TAKEN(axis=AXES[turn.axis]), *dropped.values())
            case Expired(axes):
                what = (too_old(axes),)
            case Ignored(no_turn):
                what = no_turn.reason
        needed = (Code.TURNS_NEEDED(axes=axis_names(missing)),) if missing else ()
        return (*what, *needed, *(one for one in self.refused if one not in what))
