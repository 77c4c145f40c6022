"""A calibration under way: who asked for it, which turns are taken, and what is still to be done, in words."""

from estimator.batch.capture import TurnCapture
from estimator.batch.session import CalibrationSession, Progress
from estimator.gyro import AXES
from estimator.stillness import Windows


class UnderWay:
    """Windows in, progress out. `who` asked for it and `why`; nobody, where a device has just booted."""

    def __init__(self, method: str, who: str = "", why: str = "") -> None:
        self._capture = CalibrationSession(method)
        self.who, self.why = who, why
        #: axes whose turns are taken
        self.turned: tuple[int, ...] = ()

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
    def missing(self) -> str:
        """Axes whose turns are still needed."""
        return ", ".join(AXES[axis] for axis in range(3) if axis not in self.turned)

    def add(self, windows: Windows) -> None:
        """Take the samples of the next windows, and nothing more."""
        _, rows = windows.samples
        self._capture.take(rows)

    def judge(self, begun: float, ended: float, *, still: bool) -> list[Progress]:
        """Judge what the next window whose samples were taken completes, from when to when, s."""
        return self._capture.judge(begun, ended, still=still)

    def took(self, turn: TurnCapture) -> str:
        """Note a turn; what is said of it."""
        before, self.turned = self.turned, self._capture.done()
        gone = ", ".join(AXES[axis] for axis in before if axis not in (*self.turned, turn.axis))
        needed = f"; the turn about {gone} is too old, or the bias has moved since" if gone else ""
        needed += f"; still needed: {self.missing}" if len(self.turned) < 3 else ""
        return f"turn about {AXES[turn.axis]} taken{needed}"

    def repeat(self, axes: tuple[int, ...]) -> None:
        """Turns about these axes are to be taken again."""
        self.turned = tuple(axis for axis in self.turned if axis not in axes)
