"""Events of a calibration session, in the order in which they occur."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from bridge.reasons.codes import Sentence
from estimator.calibration.capture import Rest, TurnCapture
from estimator.calibration.result import Result
from estimator.calibration.turn_recognition import NoTurn


@dataclass(frozen=True, slots=True)
class RestFound:
    """A rest long enough to measure the bias; it may go on."""

    rest: Rest


@dataclass(frozen=True, slots=True)
class TurnFound:
    """A full turn about an axis.

    dropped: turns about other axes that no longer count, with the reason. missing: axes without a turn.
    """

    turn: TurnCapture
    dropped: Mapping[int, Sentence] = field(default_factory=dict)
    missing: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Expired:
    """Turns about these axes are now too old to be combined with new ones."""

    axes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Ignored:
    """A movement that was not a full turn."""

    no_turn: NoTurn


@dataclass(frozen=True, slots=True)
class Finished:
    """A method ran on three turns, or on enough movements for a full matrix; `rest` is the latest rest."""

    result: Result
    rest: Rest


Progress = RestFound | TurnFound | Expired | Ignored | Finished
