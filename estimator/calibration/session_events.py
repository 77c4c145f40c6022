"""Events of a calibration session, in the order in which they happen."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from bridge.reasons.codes import Sentence
from estimator.calibration.capture import Rest, TurnCapture
from estimator.calibration.result import Result
from estimator.calibration.turn_recognition import NoTurn


@dataclass(frozen=True, slots=True)
class RestFound:
    """A rest long enough to take a bias from; it may go on."""

    rest: Rest


@dataclass(frozen=True, slots=True)
class TurnFound:
    """A full turn about an axis. dropped: turns about other axes that no longer count, and why; missing: axes without a turn."""

    turn: TurnCapture
    dropped: Mapping[int, Sentence] = field(default_factory=dict)
    missing: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Expired:
    """Turns about these axes are too old by now to be combined with new ones."""

    axes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Ignored:
    """A movement that was not a full turn."""

    no_turn: NoTurn


@dataclass(frozen=True, slots=True)
class Finished:
    """A method has run on what is there: three turns, or movements enough for a full matrix; `rest` is the newest."""

    result: Result
    rest: Rest


Progress = RestFound | TurnFound | Expired | Ignored | Finished
