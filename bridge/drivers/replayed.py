"""Driver that plays a recording as if its device were connected, at `speed` times the recorded pace.

Each driver plays one device of a ward's recording (.mcap). Devices that are opened together keep their relative timing.
"""

import functools
import itertools
import logging
import math
import secrets
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import DriverKind, Event, Identity, Readings
from bridge.reasons.codes import Code
from bridge.recording import MAX_BYTES, TICK_S, Reading, Recording, RecordingError, load, stretches
from bridge.recording.stretches import Recorded, Stretch
from bridge.runtime import os_errors
from bridge.transport import host_time
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.wire.messages import BootCause
from bridge.wire.refusal import Tally

_BOOTS = 2**64
_ODD = 0x9E3779B97F4A7C15  # makes different boot numbers for the stretches of one boot
_MAX_CHUNK = 4096  # samples
_SALT = secrets.randbits(64)  # one for all devices of a playback, so that devices sharing a boot number still share it
_reading = threading.Lock()
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class ReplaySegment:
    """Segment of a recording to replay: n samples of one boot, with the device's identity. Vectors are in the sensor frame.

    due_s (n,): time at which each sample is played, s since the start of the playback, never falling.
    sequence (n,): sequence numbers. ticks (n,): device time in ticks of identity.tick_period_s seconds. gyro (n, 3):
    rad/s. accel (n, 3): m/s², or None. temperature_c (n,): °C, or None.
    """

    identity: Identity
    due_s: NDArray[np.float64]
    sequence: NDArray[np.int64]
    ticks: NDArray[np.uint64]
    gyro: NDArray[np.floating]
    accel: NDArray[np.floating] | None
    temperature_c: NDArray[np.floating] | None

    def __len__(self) -> int:
        return len(self.ticks)

    @classmethod
    def of_recording(cls, recording: Recording, boot: int, gyro_range: float = 0.0) -> Self:
        """Build the segment of a recording without boot numbers: all samples belong to one boot.

        boot: boot number to use. gyro_range: full-scale range in rad/s; 0 uses the recording's.
        """
        identity = Identity(
            boot=boot,
            boot_cause=BootCause.PORT_OPENED,
            model=recording.model or recording.name,
            firmware="recording",
            rate_hz=recording.rate_hz,
            gyro_range=gyro_range or recording.gyro_range,
            tick_period_s=TICK_S,
            has_accel=recording.accel is not None,
            has_temperature=recording.temperature_c is not None,
            tick_bits=64,
            sequence_bits=64,
        )
        columns = recording.gyro, recording.accel, recording.temperature_c
        return cls(identity, recording.time_s, recording.sequence, recording.ticks, *columns)

    @classmethod
    def of_stretch(cls, stretch: Stretch, begin_ns: int, salt: int, gyro_range: float = 0.0) -> Self:
        """Build the segment of one boot (stretch) in a ward's recording.

        begin_ns: time at which the recording began, ns since the Unix epoch. salt: number that makes boot numbers
        differ between playbacks; otherwise subscribers would discard the samples as repeats.
        gyro_range: full-scale range in rad/s; 0 uses the recorded one.
        """
        info = stretch.info
        identity = Identity(
            boot=(stretch.boot + salt + stretch.number * _ODD) % _BOOTS,
            boot_cause=info.boot_cause if info else BootCause.UNKNOWN,
            model=info.model if info else "",
            firmware=info.firmware if info else "",
            rate_hz=stretch.rate_hz,
            gyro_range=gyro_range or (info.gyro_range if info else 0.0),
            tick_period_s=stretch.tick_period_s,
            has_accel=stretch.accel is not None,
            has_temperature=stretch.temperature_c is not None,
            tick_bits=64,
            sequence_bits=64,
            has_clock=info.has_clock if info else True,
        )
        due_s = np.maximum.accumulate((stretch.time_ns - begin_ns) * 1e-9)
        columns = stretch.gyro, stretch.accel, stretch.temperature_c
        return cls(identity, due_s, stretch.sequence, stretch.ticks, *columns)


class ReplayedOptions(Reading, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a replay: file, speed, full-scale range, and properties that the file lacks, as in recording.Reading.

    speed: multiple of the recorded pace. gyro_range_dps: full-scale range in °/s; 0 if unknown.
    recorded_device: id of the device to play if a .mcap holds several. Raises ValueError for an invalid option.
    """

    #: recording to play: `.npz`, `.mcap` or text such as `.csv`, for example `walk.npz`
    file: str
    #: multiple of the recorded pace, 0.01 to 1000; 2 plays twice as fast
    speed: float = 1.0
    #: full-scale range of the gyro, °/s, for example 2000; 0 if unknown
    gyro_range_dps: float = 0.0
    #: id of the recorded device to play, for example `wrist-01`; needed if a `.mcap` holds several devices
    recorded_device: str | None = None

    def __post_init__(self) -> None:
        if not 0.01 <= self.speed <= 1000:
            raise ValueError(f"speed is {self.speed:g}: use 0.01 to 1000")
        if self.rate_hz is not None and not 0 < self.rate_hz <= 10_000:
            raise ValueError(f"rate_hz is {self.rate_hz:g}: use a number above 0, up to 10000")
        if not 0 <= self.gyro_range_dps <= 10_000:
            raise ValueError(f"gyro_range_dps is {self.gyro_range_dps:g}: use 0 (unknown) to 10000")
        try:
            Reading.__post_init__(self)
        except RecordingError as error:
            raise ValueError(str(error)) from None


class Playback:
    """Schedule of a replay: returns the samples of replay segments when they are due. No I/O; time is an argument.

    takes: the segments, in the order of playing. speed: multiple of the recorded pace.
    """

    def __init__(self, takes: Sequence[ReplaySegment], speed: float) -> None:
        self._takes = [take for take in takes if len(take)]
        self._speed = speed
        self._at = 0  # index of the segment
        self._next = 0  # index of its next sample

    @property
    def over(self) -> bool:
        """True if all segments have been played to their end."""
        return self._at >= len(self._takes)

    def wait_s(self, elapsed_s: float) -> float:
        """Return the seconds of host time until the next sample is due; 0 if a sample is due now, or at the end.

        elapsed_s: host time since the start of the playback, s.
        """
        if self.over:
            return 0.0
        return max(0.0, float(self._takes[self._at].due_s[self._next]) / self._speed - elapsed_s)

    def due(self, elapsed_s: float, receive_time_ns: int) -> list[Event]:
        """Return the events due in the boot being played: runs of consecutive samples; at its start, the identity first.

        Samples of the next boot come with a later call. Returns [] if no sample is due.
        elapsed_s: host time since the start of the playback, s.
        receive_time_ns: receive time to give to the readings, ns since the Unix epoch.
        """
        if self.over or self.wait_s(elapsed_s):
            return []
        take, first = self._takes[self._at], self._next
        last = int(np.searchsorted(take.due_s, elapsed_s * self._speed, side="right"))
        last = min(max(last, first + 1), first + _MAX_CHUNK)
        self._next = last
        if last == len(take):
            self._at, self._next = self._at + 1, 0
        holes = np.flatnonzero(np.diff(take.sequence[first:last]) != 1) + 1
        edges = [first, *(first + holes).tolist(), last]
        runs = [_run(take, slice(*edge), receive_time_ns) for edge in itertools.pairwise(edges)]
        return [*([] if first else [take.identity]), *runs]


def _run(take: ReplaySegment, part: slice, receive_time_ns: int) -> Readings:
    return Readings(
        boot=take.identity.boot,
        sequence=int(take.sequence[part.start]),
        receive_time_ns=receive_time_ns,
        ticks=take.ticks[part],
        gyro=take.gyro[part],
        accel=None if take.accel is None else take.accel[part],
        temperature_c=None if take.temperature_c is None else take.temperature_c[part],
    )


def devices(path: Path) -> list[str]:
    """Return the device ids in a ward's recording (.mcap). Raises RecordingError if it is unreadable or has no samples."""
    found = list(_recorded(path).stretches)
    if not found:
        raise RecordingError(f"{path}: the recording has no samples: give another recording")
    return found


def _recorded(path: Path) -> Recorded:
    """A ward's recording, read once for all of its devices."""
    try:
        state = path.stat()
    except OSError as error:
        raise RecordingError(f"{path}: {os_errors.why(error)}") from None
    if state.st_size > MAX_BYTES:
        raise RecordingError(
            f"{path}: the file has {state.st_size} bytes; at most {MAX_BYTES} are allowed: split the file"
        )
    with _reading:
        return _read(path, state.st_mtime_ns)


@functools.lru_cache(maxsize=1)
def _read(path: Path, _changed_ns: int) -> Recorded:
    recorded = stretches.read([path], corrected=False)
    for words in recorded.trouble:
        _log.warning("%s", words)
    return recorded


def _takes(options: ReplayedOptions) -> list[ReplaySegment]:
    gyro_range = math.radians(options.gyro_range_dps)
    path = Path(options.file)
    if path.suffix != ".mcap":
        return [ReplaySegment.of_recording(load(path, reading=options), secrets.randbits(64), gyro_range)]
    recorded, whom = _recorded(path), options.recorded_device
    found = devices(path)
    if whom is None and len(found) > 1:
        raise RecordingError(f"{path}: several devices: set recorded_device to one of {', '.join(found)}")
    if whom is not None and whom not in found:
        raise RecordingError(f"{path}: no samples of recorded_device {whom!r}; choose from {', '.join(found)}")
    boots = recorded.stretches[whom or found[0]]
    return [ReplaySegment.of_stretch(boot, recorded.begin_ns, _SALT, gyro_range) for boot in boots]


class ReplayedDriver:
    """Driver that plays a recording as if its device were connected, timed by the host's monotonic clock."""

    def __init__(self, options: ReplayedOptions) -> None:
        self.faults = Tally()
        self.place = options.file
        self._options = options
        self._closed = threading.Event()
        self._playback: Playback | None = None
        self._start_s = 0.0

    def open(self) -> None:
        """Load the recording and play it from its beginning. Raises DeviceUnavailable if it cannot be played."""
        try:
            takes = _takes(self._options)
        except RecordingError as error:
            raise DeviceUnavailable(Code.PLACE_FAILED(place=self.place, error=error)) from None
        self._playback = Playback(takes, self._options.speed)
        self._start_s = time.monotonic()
        self._closed.clear()

    def read(self, timeout_s: float) -> list[Event]:
        """Return the events that are due; waits at most timeout_s seconds for them.

        Raises DeviceLost at the end of the recording (with over=True), and if the driver is closed.
        """
        playback = self._playback
        if playback is None:
            raise DeviceLost(Code.CLOSED(place=self.place))
        if playback.over:
            raise DeviceLost(Code.RECORDING_OVER(place=self.place), over=True)
        self._closed.wait(min(timeout_s, playback.wait_s(time.monotonic() - self._start_s)))
        return playback.due(time.monotonic() - self._start_s, host_time.now_ns())

    def close(self) -> None:
        """Stop playing the recording; this ends a `read` in another thread."""
        self._closed.set()
        self._playback = None


def _state(options: ReplayedOptions) -> str:
    return os_errors.unreadable(Path(options.file)) or "present"


KIND = DriverKind(
    name="replayed",
    summary="a recording (.npz, .mcap, .csv and other text) played as a device: file, speed, rate_hz, gyro_unit, recorded_device",
    options=ReplayedOptions,
    make=ReplayedDriver,
    state=_state,
)
