"""Conversion of a recording into the sample batches and device info that a bridge would publish."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bridge.ingest.plausibility import PLAUSIBLE
from bridge.ingest.sensor_faults import SensorFaults
from bridge.recording import TICK_S, Recording, RecordingError, Told
from bridge.wire.messages import BootCause, DeviceInfo, SampleBatch, SampleFlag
from bridge.wire.refusal import Tally

#: number of the boot that every recording counts as
BOOT = 1


def batches(recording: Recording, gyro_range: float, size: int) -> Iterator[SampleBatch]:
    """Yield batches as a bridge publishes them: at most `size` consecutive samples each, faulty samples flagged.

    gyro_range: full-scale range, rad/s; 0 when unknown. Raises RecordingError for a reading that is not finite or far
    beyond the range.
    """
    _check_range(recording, gyro_range)
    told = recording.told or Told(recording.ticks, TICK_S, recording.sequence, flags_of(recording, gyro_range))
    sequence, ticks, flags = told.sequence, told.ticks, told.flags.copy()
    holes = np.flatnonzero(np.diff(sequence) != 1) + 1
    after_hole = set(holes.tolist())
    edges = np.unique(np.concatenate([np.arange(0, len(recording), size), holes, [len(recording)]])).tolist()
    for start, end in pairwise(edges):
        if start in after_hole:
            flags[start] |= np.uint32(SampleFlag.AFTER_GAP)
        accel, warm = recording.accel, recording.temperature_c
        yield SampleBatch(
            device="recorded",
            boot=BOOT,
            sequence=int(sequence[start]),
            receive_time_ns=0,
            start_time_ns=0,
            tick_period_s=told.tick_period_s,
            clock_rate=1.0,
            ticks=ticks[start:end],
            gyro=recording.gyro[start:end].astype(np.float32),
            accel=None if accel is None else accel[start:end].astype(np.float32),
            temperature_c=None if warm is None else warm[start:end].astype(np.float32),
            flags=flags[start:end],
        )


def _check_range(recording: Recording, gyro_range: float) -> None:
    """Refuse readings far beyond the range, or not finite: live they are dropped, but here every sample needs a row."""
    read = recording.gyro if recording.accel is None else np.hstack((recording.gyro, recording.accel))
    odd = np.flatnonzero(~(np.abs(read) <= np.finfo(np.float32).max).all(axis=1))
    if len(odd):
        raise RecordingError(
            f"{recording.name}: sample {odd[0]} is not a finite number: remove such samples from the recording"
        )
    limit = PLAUSIBLE * gyro_range if gyro_range else np.inf
    beyond = np.flatnonzero(np.any((recording.gyro > limit) | (recording.gyro < -limit), axis=1))
    if len(beyond):
        most = np.degrees(np.abs(recording.gyro[beyond[0]]).max())
        raise RecordingError(
            f"{recording.name}: {most:.0f} °/s at sample {beyond[0]} is more than twice the range given, "
            f"{np.degrees(gyro_range):.0f} °/s: give the right range"
        )


def flags_of(recording: Recording, gyro_range: float) -> NDArray[np.uint32]:
    """Return the SampleFlags (n,) that a bridge would set. gyro_range: full-scale range, rad/s; 0 when unknown."""
    warm = None if recording.temperature_c is None else recording.temperature_c.astype(np.float32)
    time_s = recording.ticks * TICK_S
    return SensorFaults(Tally()).flags(time_s, recording.gyro.astype(np.float32), warm, gyro_range)


def info_of(recording: Recording) -> DeviceInfo:
    """Return the device info that a bridge would publish of the recording's device."""
    return DeviceInfo(
        device="recorded",
        bridge="",
        boot=BOOT,
        boot_cause=BootCause.PORT_OPENED,
        model=recording.name,
        firmware="recording",
        driver="",
        port="",
        rate_hz=recording.rate_hz,
        measured_rate_hz=recording.rate_hz,
        gyro_range=0.0,
        has_accel=recording.accel is not None,
        has_temperature=recording.temperature_c is not None,
        time_ns=0,
    )
