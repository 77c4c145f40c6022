"""Smoothing of a corrected recording: corrects it again with a bias that is estimated from later samples, too."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bridge.recording import Recording, RecordingError
from bridge.wire.messages import CorrectedBatch, Quality, combined_std
from estimator.device.session import DeviceSession
from estimator.device.session_knobs import SessionKnobs
from estimator.kernels.orientation import KNOWN_ACCEL_STD, KNOWN_NOISE, KNOWN_STD, TRACE
from estimator.offline.corrected_recording import Floats, Rows
from estimator.orientation.attitude import Attitude, Oriented
from estimator.orientation.smoothing import smooth
from estimator.samples.sample_buffer import ACCEL, CLIPPED, GYRO, TIME, WIDTH

#: rows processed at a time, to limit memory
_ROWS = 100_000


def remembering(knobs: SessionKnobs) -> SessionKnobs:
    """Return the session settings with a tracker that keeps the whole boot's history, as smoothing needs."""
    return replace(knobs, track=replace(knobs.track, history=None))


def smooth_rows(rows: Rows, recording: Recording, session: DeviceSession, last: CorrectedBatch, matrix: Floats) -> None:
    """Overwrite the rows with the smoothed bias, and with the rates and attitudes that follow from it.

    rows: to overwrite. recording: the readings. session: finished session of the whole recording; its tracker gives the
    smoothed bias, its last calibration the correction.
    last: last corrected batch. matrix (3, 3): its calibration matrix.
    Before the first and after the last point of the bias history, the bias's uncertainty grows by its rate random walk.
    Raises RecordingError if there is no evidence of the bias.
    """
    found = session.tracker.smoothed()
    if found is None:
        raise RecordingError(f"{recording.name}: nothing to smooth, because no rest shows the bias; use --realtime")
    time, bias, std = found.time, found.bias, found.std
    walk = session.knobs.track.bias.rate_random_walk
    device_time = recording.device_time
    for start in range(0, len(recording), _ROWS):
        part = slice(start, start + _ROWS)
        now = device_time[part]
        outside_s = np.maximum(0.0, np.maximum(time[0] - now, now - time[-1]))
        bias_now = _between(now, time, bias)
        bias_std = np.hypot(_between(now, time, std), walk * np.sqrt(outside_s)[:, None])
        rate = (recording.gyro[part] - bias_now) @ matrix.T
        left = np.sqrt(np.square(bias_std) @ np.square(matrix).T)
        rows.rate[part], rows.bias[part], rows.bias_std[part] = rate, bias_now, bias_std
        rows.rate_std[part] = combined_std(rate, last.noise_std, left, last.scale_std, last.cross_std, last.flicker_std)
    rows.quality[:] = _quality(rows, session)
    _smooth_attitudes(rows, recording, session)


def _quality(rows: Rows, session: DeviceSession) -> NDArray[np.int64]:
    """Return the boot's best quality for all rows; rows under a doubt that was never cleared keep the doubt."""
    unsure = np.any(rows.bias_std >= session.knobs.track.bias_std, axis=1)
    known, doubted = Quality.GOOD, Quality.DEGRADED
    if session.calibration is None:
        known, doubted = Quality.BIAS_ONLY, Quality.PRIOR if session.prior else Quality.NONE
    if session.tracker.doubt.stands:
        trusted = np.flatnonzero(rows.quality != doubted)
        unsure[trusted[-1] + 1 if len(trusted) else 0 :] = True
    return np.where(unsure, doubted, known)


def _smooth_attitudes(rows: Rows, recording: Recording, session: DeviceSession) -> None:
    """Overwrite the attitudes: once more from the smoothed rates, and levelled by later samples too."""
    applied, attitude = session.applied, Attitude()
    known = applied.known.copy()  # the rates are corrected already, but for what gravity has taught of the matrix
    known[:KNOWN_STD] = *(known[:9].reshape(3, 3) @ np.linalg.inv(applied.model.matrix)).ravel(), *np.zeros(3)
    samples = np.full((len(recording), WIDTH), np.nan)
    samples[:, TIME], samples[:, GYRO], samples[:, CLIPPED] = recording.device_time, rows.rate, 0.0
    if recording.accel is not None:
        samples[:, ACCEL] = recording.accel
    trace, parts = np.empty((len(recording), TRACE)), list[Oriented]()
    seconds = np.flatnonzero(np.diff(np.floor(samples[:, TIME]), prepend=-np.inf)).tolist()
    for start, end in pairwise([*seconds, len(recording)]):
        known[KNOWN_STD : KNOWN_STD + 3] = rows.bias_std[start]
        found, trace[start:end] = attitude.traced(samples[start:end], known)
        parts.append(found)
    whole = Oriented(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    rows.turn(smooth(whole, trace, known[KNOWN_ACCEL_STD:KNOWN_NOISE]), 0)


def _between(now: Floats, time: Floats, values: Floats) -> Floats:
    """Interpolate values (m, 3) at times (m,) linearly to the times `now` (n,), s; return (n, 3)."""
    return np.column_stack([np.interp(now, time, column) for column in values.T])
