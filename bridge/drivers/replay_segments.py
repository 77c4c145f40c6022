"""Replay segments: the samples of one boot, their device's identity, and when each sample is due."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Identity
from bridge.recording import TICK_S, Recording
from bridge.recording.stretches import Stretch
from bridge.wire.messages import BootCause

_BOOTS = 2**64
_ODD = 0x9E3779B97F4A7C15  # makes different boot numbers for the stretches of one boot


@dataclass(frozen=True, slots=True, eq=False)
class ReplaySegment:
    """Replay segment: n samples of one boot to replay, with the device's identity.

    due_s (n,): seconds since the playback began at which each sample is played, never falling. The other columns are as
    in
    driver.Readings: gyro (n, 3) rad/s, accel (n, 3) m/s², temperature_c (n,) °C.
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
        """Build the segment of a recording that has no boots: its boot begins as the recording is opened.

        boot: boot number to use. gyro_range: full scale in rad/s; 0 takes the recording's.
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
        """Build the segment of one boot (stretch) of a ward's recording.

        begin_ns: host time at which the recording began, ns. salt: makes the boot number differ in every playback;
        otherwise subscribers would take the samples for repeats. gyro_range: full scale in rad/s; 0 takes the recorded
        one.
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
