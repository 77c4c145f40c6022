"""Inspection of a recording: sampling rate, gaps, noise at rest, gravity, and remarks of its reader."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from bridge.recording.plausibility import quietest
from bridge.recording.recording import Recording


def findings(recording: Recording) -> dict[str, Any]:
    """Inspect a recording; returns JSON-compatible values in SI units, by name.

    samples: number of samples. duration_s: time from the first sample to the last.
    rate_hz: sampling rate of the recording. measured_hz: inverse of the median time step.
    gaps: for each gap, after_s (time of the last sample before the gap, s since the first sample) and missing (number
    of missing samples).
    noise, rest_mean (3,): standard deviation and mean of the readings in the quietest window of 1 s, rad/s.
    most (3,): largest absolute reading of each axis, rad/s. gravity: median magnitude of the acceleration vector,
    m/s²; None without an accelerometer. temperature_c: lowest and highest, or None. notes: sentences of the reader
    on assumptions and repairs.
    """
    missing = np.diff(recording.sequence) - 1
    rest = recording.gyro[quietest(recording.gyro, recording.rate_hz)]
    accel, warm = recording.accel, recording.temperature_c
    return {
        "samples": len(recording),
        "duration_s": float(recording.time_s[-1]),
        "rate_hz": recording.rate_hz,
        "measured_hz": float(1 / np.median(np.diff(recording.time_s))),
        "gaps": [
            {"after_s": float(recording.time_s[at]), "missing": int(missing[at])} for at in np.flatnonzero(missing)
        ],
        "noise": rest.std(axis=0).tolist(),
        "rest_mean": rest.mean(axis=0).tolist(),
        "most": np.abs(recording.gyro).max(axis=0).tolist(),
        "gravity": None if accel is None else float(np.median(np.linalg.norm(accel, axis=1))),
        "temperature_c": None if warm is None else (float(warm.min()), float(warm.max())),
        "notes": recording.notes,
    }


def sentences(found: Mapping[str, Any]) -> list[str]:
    """Return the findings of an inspection as lines of text for the user; rates are in °/s.

    found: result of `findings`.
    """
    noise, mean, most = (
        ", ".join(f"{axis} {value:.4g}" for axis, value in zip("xyz", np.degrees(found[name]), strict=True))
        for name in ("noise", "rest_mean", "most")
    )
    gaps, gravity, celsius = found["gaps"], found["gravity"], found["temperature_c"]
    lost = sum(gap["missing"] for gap in gaps)
    at = f", the first of {gaps[0]['missing']} at {gaps[0]['after_s']:.3f} s" if gaps else ""
    lines = [
        f"samples:     {found['samples']} in {found['duration_s']:.3f} s",
        f"rate:        {found['rate_hz']:.6g} Hz; the median step is {1 / found['measured_hz']:.6g} s",
        f"gaps:        {len(gaps)}, {lost} samples missing{at}",
        f"quietest second: mean {mean} °/s; standard deviation {noise} °/s",
        f"largest:     {most} °/s",
        "gravity:     no accelerometer" if gravity is None else f"gravity:     {gravity:.4g} m/s², median length",
    ]
    if celsius is not None:
        lines.append(f"temperature: {celsius[0]:.1f} to {celsius[1]:.1f} °C")
    return [*lines, *(f"note:        {words}" for words in found["notes"])]
