"""Whom messages come from, and where each is for as long as it only goes on: a row of numbers each, for the compiled loops."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.wire import columns_pb2 as columns
from bridge.wire.batches import Stencil
from bridge.wire.messages import VERSION
from estimator.correction import Correction
from estimator.course import Point
from estimator.loops.messages import ALL, BEGIN, LATEST, NAME, NEXT, OF_BOOT, PARAMETERS, SHIFT, UNTIL

#: bytes before and behind the samples of a corrected message that there is room for
_ROOM = 256


class Sender(NamedTuple):
    """A device, the bridge it comes from, and how each message of it begins."""

    device: str
    bridge: str
    begin: bytes

    @classmethod
    def of(cls, device: str, bridge: str) -> "Sender":
        """The one of this device and this bridge."""
        return cls(device, bridge, columns.SampleBatch(version=VERSION, device=device).SerializeToString())


class Senders:
    """Up to `most` of them, each in its place; for the arrays see loops/messages.py."""

    def __init__(self, most: int) -> None:
        self._numbers, self._reals = np.zeros((most, 5), np.uint64), np.zeros((most, PARAMETERS + 12))
        self._begins = np.zeros((most, _ROOM), np.uint8)

    @property
    def table(self) -> tuple[NDArray[np.uint64], NDArray[np.float64], NDArray[np.uint8]]:
        """All that is known of them."""
        return self._numbers, self._reals, self._begins

    @property
    def said(self) -> tuple[NDArray[np.float64], NDArray[np.uint64], NDArray[np.uint8]]:
        """What corrected messages are made with: parameters, lengths, and what is before and behind their samples."""
        return self._reals[:, PARAMETERS:], self._numbers[:, BEGIN : ALL + 1], self._begins

    def admit(self, place: int, sender: Sender) -> None:
        """From now on this one is here; where it is is not known yet."""
        begin = sender.begin
        self._numbers[place] = 0
        self._numbers[place, NAME] = len(begin)
        self._begins[place, : len(begin)] = np.frombuffer(begin, np.uint8)

    def corrects(self, place: int, correction: Correction, stencil: Stencil) -> bool:
        """What comes next of it is corrected so, and enclosed; whether there is room for that."""
        enclosing = stencil.begin + stencil.end  # begins as its own messages do
        if len(enclosing) > _ROOM:
            return False
        self._numbers[place, BEGIN], self._numbers[place, ALL] = len(stencil.begin), len(enclosing)
        self._begins[place, : len(enclosing)] = np.frombuffer(enclosing, np.uint8)
        self._reals[place, PARAMETERS:] = correction.parameters
        return True

    def stands(self, place: int, boot: int, following: int, point: Point) -> None:
        """What comes next of it goes on from here: the number of its next sample, and its course."""
        numbers, reals = self._numbers, self._reals
        numbers[place, OF_BOOT], numbers[place, NEXT] = boot, following
        reals[place, LATEST], reals[place, SHIFT], reals[place, UNTIL] = point

    def lose(self, place: int) -> None:
        """Nothing goes on from where it is."""
        self._numbers[place, NEXT] = 0
