"""Reader of a ward for robotics outlets: each sample once, poses for a 3-D view, statuses, and events as text."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from bridge.reasons.catalogue import explain
from bridge.ros.imu_rows import ImuJoin, ImuRows
from bridge.wire.messages import Quality, State, Status, Verdict
from estimator.client import Client
from estimator.outlets.places import Places

#: devices in a row of the grid, and the distance between them, m
_COLUMNS, _APART = 6, 0.5
_NOT_TURNED = (1.0, 0.0, 0.0, 0.0)


class Pose(NamedTuple):
    """Pose of a device in the coordinate frame of its ward.

    time_ns: host time, ns since the Unix epoch. position: place on a display grid, m; it is not measured. quat_wxyz:
    unit quaternion from sensor to earth axes, scalar first.
    """

    device: str
    time_ns: int
    position: tuple[float, float, float]
    quat_wxyz: tuple[float, float, float, float]


class Event(NamedTuple):
    """Event of a device as text: a note, a calibration, or a change of its state.

    time_ns: host time, ns since the Unix epoch. serious: whether a person should look at the device.
    """

    time_ns: int
    device: str
    words: str
    serious: bool


class WardFeed:
    """Reader of a ward's streams for an outlet; call its methods repeatedly, from one thread.

    devices: ids, None for all. left(device): called for a device that lost its place to another; the outlet can then
    drop its state of that device.
    """

    def __init__(self, client: Client, devices: Sequence[str] | None, left: Callable[[str], None]) -> None:
        # Raw readings are for those who may hear them: without them, samples have no acceleration.
        self._rates = client.corrected(devices, quiet=True)
        self._raw = client.raw(devices)
        self._orientation = client.orientation(devices)
        self._statuses = client.follow(devices)
        self._notes = client.follow_notes(devices)
        self._calibrations = client.follow_calibrations(devices)
        self._join = ImuJoin()
        self._places, self._left = Places(self._leave), left
        #: number of each device's place on the grid
        self._grid: dict[str, int] = {}
        self._states: dict[str, tuple[int, State, Quality]] = {}

    def samples(self, timeout_s: float) -> Iterator[ImuRows]:
        """Wait at most `timeout_s` seconds for corrected samples, and yield joined samples, one ImuRows per batch.

        Joined samples have corrected rates (rad/s), raw readings and orientations. A batch waits for its readings and
        orientations, at most 0.5 s.
        """
        self._rates.wait(timeout_s)
        now_s = time.monotonic()
        for stream in (self._raw, self._orientation):
            for batch in stream.drain():
                yield from self._join.take(batch, now_s)
        for corrected in self._rates.drain():
            if self._places.take(corrected.device, now_s):
                yield from self._join.take(corrected, now_s)
        yield from self._join.due(now_s)

    def statuses(self) -> list[Status]:
        """Return the statuses that arrived since the last call; each device sends one a second."""
        now_s = time.monotonic()
        return [status for status in self._statuses.drain() if self._places.take(status.device, now_s)]

    def pose(self, rows: ImuRows) -> Pose:
        """Return a device's pose: its place on the display grid, and its orientation at the last of the samples.

        rows: joined samples of the device. An unknown orientation (NaN) becomes the identity rotation.
        """
        w, x, y, z = rows.quat_wxyz[-1].tolist()
        turned = _NOT_TURNED if math.isnan(w) else (w, x, y, z)
        return Pose(rows.device, int(rows.time_ns[-1]), self._position(rows.device), turned)

    def _leave(self, device: str) -> None:
        self._states.pop(device, None)
        self._grid.pop(device, None)
        self._left(device)

    def _position(self, device: str) -> tuple[float, float, float]:
        if device not in self._grid:
            self._grid[device] = min(set(range(len(self._grid) + 1)) - set(self._grid.values()))
        row, column = divmod(self._grid[device], _COLUMNS)
        return column * _APART, -row * _APART, 0.0

    def events(self, statuses: Sequence[Status]) -> Iterator[Event]:
        """Yield the events since the last call: changes of state in these statuses, new calibrations and notes."""
        for status in statuses:
            state = status.boot, State(status.state), Quality(status.quality)
            if self._states.get(status.device) != state:
                self._states[status.device] = state
                words = f"{state[1].name}, quality {state[2].name}: {explain(status.reason)}"
                yield Event(status.time_ns, status.device, words, state[1] in (State.DEGRADED, State.LOST))
        for one in self._calibrations.drain():
            verdict = Verdict(one.verdict)
            words = f"calibration {verdict.name}: {explain(one.reason)}"
            yield Event(one.time_ns, one.device, words, verdict is not Verdict.ACCEPTED)
        for note in self._notes.drain():
            yield Event(note.time_ns, note.device, f"{note.who}: {note.text}", serious=False)
