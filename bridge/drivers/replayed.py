"""A recording played as if it were a device, without a port: at its own pace, or `speed` times that."""

import itertools
import math
import secrets
import threading
import time
from pathlib import Path

import numpy as np
from msgspec import Struct

from bridge.drivers.driver import DeviceLost, DeviceUnavailable, DriverKind, Event, Identity, Readings
from bridge.recording import TICK_S, Recording, RecordingError, load
from bridge.wire.messages import BootCause
from bridge.wire.refusal import Tally

_CHUNK_S = 0.02  # host seconds between deliveries
_MAX_CHUNK = 512  # samples


class ReplayedOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The recording (.npz or .csv), how many times faster than it was, its rate where the file does not say it."""

    file: str
    speed: float = 1.0
    rate_hz: float | None = None
    gyro_range_dps: float = 0.0

    def __post_init__(self) -> None:
        if not 0.01 <= self.speed <= 1000:
            raise ValueError(f"speed is {self.speed:g}; 0.01 to 1000 is taken")
        if not 0 <= self.gyro_range_dps <= 10_000:
            raise ValueError(f"gyro_range_dps is {self.gyro_range_dps:g}; 0 (unknown) to 10000 is taken")


class Playback:
    """What of a recording is due: pure, host seconds since the start are an argument."""

    def __init__(self, recording: Recording, speed: float, boot: int, gyro_range: float = 0.0) -> None:
        self.recording = recording
        self.speed = speed
        self.boot = boot
        self._gyro_range = gyro_range
        self._ticks = recording.ticks
        self._sequence = recording.sequence
        self._next = 0

    @property
    def over(self) -> bool:
        """Everything has been played."""
        return self._next >= len(self.recording)

    def identity(self) -> Identity:
        """Who plays; a recording knows no boot, so this one begins as the port is opened."""
        return Identity(
            boot=self.boot,
            boot_cause=BootCause.PORT_OPENED,
            model=self.recording.name,
            firmware="recording",
            rate_hz=self.recording.rate_hz,
            gyro_range=self._gyro_range,
            tick_period_s=TICK_S,
            has_accel=self.recording.accel is not None,
            has_temperature=self.recording.temperature_c is not None,
            tick_bits=64,
            sequence_bits=64,
        )

    def wait_s(self, elapsed_s: float) -> float:
        """Host seconds until the next sample is due; 0 when it is, or all is over."""
        if self.over:
            return 0.0
        return max(0.0, float(self.recording.time_s[self._next]) / self.speed - elapsed_s)

    def due(self, elapsed_s: float, receive_time_ns: int) -> list[Readings]:
        """What is due by elapsed_s, in runs of consecutive samples."""
        recording, first = self.recording, self._next
        last = int(np.searchsorted(recording.time_s, elapsed_s * self.speed, side="right"))
        last = min(last, first + _MAX_CHUNK)
        self._next = max(first, last)
        holes = np.flatnonzero(np.diff(self._sequence[first:last]) != 1) + 1
        edges = [first, *(first + holes).tolist(), last]
        return [
            Readings(
                boot=self.boot,
                sequence=int(self._sequence[start]),
                receive_time_ns=receive_time_ns,
                ticks=self._ticks[start:end],
                gyro=recording.gyro[start:end],
                accel=None if recording.accel is None else recording.accel[start:end],
                temperature_c=None if recording.temperature_c is None else recording.temperature_c[start:end],
            )
            for start, end in itertools.pairwise(edges)
            if end > start
        ]


class ReplayedDriver:
    """A playback with a clock."""

    def __init__(self, options: ReplayedOptions) -> None:
        self.faults = Tally()
        self.place = options.file
        self._options = options
        self._closed = threading.Event()
        self._playback: Playback | None = None
        self._start_s = 0.0
        self._greeted = False

    def open(self) -> None:
        """Load the recording; raises DeviceUnavailable."""
        try:
            recording = load(self._options.file, self._options.rate_hz)
        except RecordingError as error:
            raise DeviceUnavailable(str(error)) from None
        gyro_range = math.radians(self._options.gyro_range_dps)
        self._playback = Playback(recording, self._options.speed, secrets.randbits(64), gyro_range)
        self._start_s = time.monotonic()
        self._greeted = False
        self._closed.clear()

    def read(self, timeout_s: float) -> list[Event]:
        """What is due; at the end DeviceLost, for good."""
        playback = self._playback
        if playback is None:
            raise DeviceLost(f"{self.place}: closed")
        if not self._greeted:
            self._greeted = True
            return [playback.identity()]
        if playback.over:
            raise DeviceLost(f"{self.place}: the recording is over", over=True)
        wait_s = max(_CHUNK_S, playback.wait_s(time.monotonic() - self._start_s))
        self._closed.wait(min(timeout_s, wait_s))
        return list(playback.due(time.monotonic() - self._start_s, time.time_ns()))

    def close(self) -> None:
        """Stop playing, ending a read in another thread."""
        self._closed.set()
        self._playback = None


def _state(options: ReplayedOptions) -> str:
    return "present" if Path(options.file).is_file() else "missing; there is no such file"


KIND = DriverKind(
    name="replayed",
    summary="a recording (.npz or .csv) played as a device: file, speed, rate_hz, gyro_range_dps",
    options=ReplayedOptions,
    make=ReplayedDriver,
    state=_state,
)
