"""What a person is told at one moment: the step, the picture, the ring, and what was wrong."""

from dataclasses import dataclass, field
from enum import StrEnum

from bridge.reasons.codes import Sentences


@dataclass(frozen=True, slots=True)
class Words:
    """A text of the guide: its key, and what is filled in."""

    key: str
    values: dict[str, str] = field(default_factory=dict)


class Step(StrEnum):
    """Where somebody is in a calibration by hand."""

    AWAY = "away"  # nothing comes from it
    BROKEN = "broken"  # who would hear it does not answer: that is not the device's fault
    REFUSED = "refused"  # the estimator does not take what it sends, and says why
    IDLE = "idle"  # it is calibrated, and nobody asks for anything
    WARM = "warm"  # it was just switched on
    PLACE = "place"  # put it against the edge, and let it rest
    TURN = "turn"  # turn it about an axis that is still needed
    TURNING = "turning"
    STAND = "stand"  # stand it on its side, so that the axis that is still needed is level
    POSE = "pose"  # of a method by movements: lay it on another side
    SETTLE = "settle"  # put down again: let it rest until the turn is judged
    DONE = "done"
    CANCELLED = "cancelled"  # an earlier calibration stays


class Picture(StrEnum):
    """What is drawn. The way to turn is named by the table: its top, along its edge, or over its edge.

    SIDE: it is to be stood on its side first.
    """

    EDGE = "edge"
    FLAT = "flat"
    ALONG = "along"
    ACROSS = "across"
    SIDE = "side"
    POSE = "pose"
    WELL = "well"
    NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class Instruction:
    """What is told now.

    ring: 0 to 1, of the rest (PLACE, SETTLE) or of the whole turn (TURNING). angle: rad turned about `axis`, signed.
    axis: the one that is turned about, or is to be next. done, needed: axes, in the order they are best turned.
    wrong: why the last try does not count; rebooted: turns were lost as it was switched off and on.
    sides: of a method by movements, on which of its six sides it has rested: 2 axis, and 1 more where that axis points down;
    None where it is calibrated by turns.
    """

    step: Step
    picture: Picture
    head: Words
    ring: float = 0.0
    angle: float = 0.0
    axis: int | None = None
    done: tuple[int, ...] = ()
    needed: tuple[int, ...] = ()
    wrong: Sentences = ()
    rebooted: bool = False
    sides: tuple[int, ...] | None = None
    ways: tuple[Picture, Picture, Picture] = (Picture.ALONG, Picture.ACROSS, Picture.FLAT)
