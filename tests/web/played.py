"""A device on the ward in memory that a scripted hand turns, judged by a real session; as fast as a test likes."""

import threading
import time
from collections.abc import Sequence
from itertools import pairwise

from bridge.sim.motion import Piece, Still
from bridge.wire.messages import CommandReply
from estimator.device.session import DeviceSession
from tests.estimator.guide.scripted import BATCH
from tests.estimator.stream import NAME, feed, stream
from tests.web.talk import Talk, about


class Played:
    """Bridge, estimator and hand of one device. `play` lets the hand go on; commands of pages are obeyed meanwhile."""

    def __init__(self, talk: Talk, speed: float = 20.0) -> None:
        self._talk, self._speed, self._lock = talk, speed, threading.Lock()
        self._boot = 0
        self.session = DeviceSession(NAME)
        talk.answer = self._obey

    def switch_on(self, pieces: Sequence[Piece], seed: int = 1) -> None:
        """A new boot, in which it will live through these pieces."""
        self._boot += 1
        self._time_s = 0.0
        self._ends = [0.0]
        for piece in pieces:
            self._ends.append(self._ends[-1] + piece.duration_s)
        whole = stream([*pieces, Still(60.0)], self._ends[-1] + 60.0, seed=seed)
        self._batches = whole.batches(range(BATCH, len(whole), BATCH), boot=self._boot)
        self._talk(about(NAME, boot=self._boot, time_ns=time.time_ns()))
        self.play(1.6)

    def play(self, seconds: float) -> None:
        """So many seconds of the device's time."""
        until, shown = self._time_s + seconds, time.monotonic() - self._time_s / self._speed
        while self._batches and self._time_s < until:
            batch = self._batches.pop(0)
            self._time_s = float(batch.device_time[-1])
            with self._lock:
                made = feed(self.session, [batch])
                self._talk(batch)
                if made.calibration is not None:
                    self._talk(made.calibration)
                if made.changed:
                    self._say()
            time.sleep(max(0.0, shown + self._time_s / self._speed - time.monotonic()))

    def play_piece(self, number: int, share: float = 1.0) -> None:
        """Up to so much of a piece."""
        begin, end = list(pairwise(self._ends))[number]
        self.play(begin + share * (end - begin) - self._time_s)

    def _say(self) -> None:
        self._talk(self.session.status(time.time_ns()))

    def _obey(self, verb: str, device: str) -> CommandReply:
        with self._lock:
            why = self.session.recalibrate("nurse", "") if verb == "recalibrate" else self.session.cancel("nurse")
        # Said by the thread that answers, which holds the talk's lock no longer when it is asked again.
        threading.Timer(0.05, self._say).start()
        return CommandReply("", accepted=why is None, message=self.session.life.reason if why is None else (why,))
