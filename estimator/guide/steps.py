"""Instruction data for a person at one moment: step, picture, progress and faults."""

from dataclasses import dataclass, field
from enum import StrEnum

from bridge.reasons.codes import Sentences


@dataclass(frozen=True, slots=True)
class Words:
    """Sentence of the guide: the key of its text in each language, and the values to fill in."""

    key: str
    values: dict[str, str] = field(default_factory=dict)


class Step(StrEnum):
    """Step of a calibration by hand, from a silent device (AWAY) to a finished calibration (DONE)."""

    AWAY = "away"  # the device sends nothing
    BROKEN = "broken"  # the router does not answer; the device is not at fault
    REFUSED = "refused"  # the estimator rejects the device's messages and says why
    IDLE = "idle"  # calibrated, and no calibration is requested
    WARM = "warm"  # just switched on and warming up
    PLACE = "place"  # put the device against the edge and let it rest
    TURN = "turn"  # turn the device about an axis still needed
    TURNING = "turning"
    STAND = "stand"  # stand the device on its side, so that the axis still needed is level
    POSE = "pose"  # for methods by movements: lay the device on another side
    SETTLE = "settle"  # device put down again: let it rest until the turn is judged
    DONE = "done"
    CANCELLED = "cancelled"  # an earlier calibration stays in force


class Picture(StrEnum):
    """Picture to show to a person: a device at rest, or how to turn it.

    FLAT: turn it round once, flat on the table. ALONG: roll it over, away from the person. ACROSS: tip it to the right,
    all the way round. SIDE: stand it on its side first.
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
    """Instruction to a person at one moment: the step, the picture, the sentence (`head`), and the progress.

    ring: progress 0 to 1, of the rest (PLACE, SETTLE) or of the whole turn (TURNING).
    angle: angle turned about `axis`, rad, signed. axis: axis (0, 1, 2) of the present or the next turn.
    done, needed: axes turned, and axes still to turn, the easiest first. wrong: why the last attempt was not accepted.
    rebooted: turns were lost because the device was switched off and on.
    laid: the device was only laid on another face, which is no fault.
    sides: for methods by movements, sides on which the device has rested: 2 × axis, plus 1 if the axis points down.
    None for methods by turns.
    ways: for each axis, the picture of how to turn the device about it; for a turn that is done, of how it was turned.
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
    laid: bool = False
    sides: tuple[int, ...] | None = None
    ways: tuple[Picture, Picture, Picture] = (Picture.ALONG, Picture.ACROSS, Picture.FLAT)

    @property
    def how(self) -> str:
        """Key of the text that explains how to do this step."""
        if self.laid:
            return "laid"
        return "degraded" if self.head.key == "degraded" else self.step.value
