"""Events that a calibration session reports, listed in the order in which they occur."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from bridge.reasons.codes import Sentence
from estimator.calibration.capture import Rest, TurnCapture
from estimator.calibration.result import Result
from estimator.calibration.turn_recognition import NoTurn


@dataclass(frozen=True, slots=True)
class RestFound:
    """Event: a rest is now long enough to measure the bias, and may still continue."""

    rest: Rest


@dataclass(frozen=True, slots=True)
class TurnFound:
    """Event: a movement was recognised as a full turn about an axis.

    dropped: reason by axis (0 to 2), for earlier turns about other axes that are now discarded.
    missing: axes (0 to 2) without a turn.
    """

    turn: TurnCapture
    dropped: Mapping[int, Sentence] = field(default_factory=dict)
    missing: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Expired:
    """Event: the turns about these axes (0 to 2) are now too old to be combined with new ones."""

    axes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Ignored:
    """Event: a movement was not a full turn; `no_turn` gives the reason."""

    no_turn: NoTurn


@dataclass(frozen=True, slots=True)
class Finished:
    """Event: the calibration method ran, on three turns or on enough movements for a full matrix.

    result: its outcome, whose verdict may also be REPEAT or REFUSED. rest: the latest rest.
    """

    result: Result
    rest: Rest


Progress = RestFound | TurnFound | Expired | Ignored | Finished
