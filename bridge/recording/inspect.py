"""Inspects a recording: rate, gaps, noise at rest, gravity, and the reader's notes and doubts."""

from typing import NamedTuple

import numpy as np

from bridge.recording.plausibility import quietest
from bridge.recording.recording import Recording

_AXES = "xyz"


class Gap(NamedTuple):
    """Gap in a recording.

    after_s: time of the last sample before it, s since the first sample. missing: number of samples.
    """

    after_s: float
    missing: int


class Findings(NamedTuple):
    """Results of inspecting a recording, in SI units.

    samples: number of samples. rate_hz: the rate in use; measured_hz: the rate by the median step.
    noise, rest_mean (3,): standard deviation and mean of the quietest second, rad/s. most (3,): largest absolute rates,
    rad/s. gravity: median length of the acceleration, m/s²; None without an accelerometer. temperature_c: lowest and
    highest, or None. notes: what the reader understood, repaired or doubted.
    """

    samples: int
    duration_s: float
    rate_hz: float
    measured_hz: float
    gaps: list[Gap]
    noise: list[float]
    rest_mean: list[float]
    most: list[float]
    gravity: float | None
    temperature_c: tuple[float, float] | None
    notes: tuple[str, ...]


def findings(recording: Recording) -> Findings:
    """Inspect a recording: rate, gaps, noise at rest, gravity, temperature and the reader's notes."""
    steps = np.diff(recording.time_s)
    missing = np.diff(recording.sequence) - 1
    gaps = [Gap(float(recording.time_s[at]), int(missing[at])) for at in np.flatnonzero(missing)]
    rest = recording.gyro[quietest(recording.gyro, recording.rate_hz)]
    accel, warm = recording.accel, recording.temperature_c
    return Findings(
        samples=len(recording),
        duration_s=float(recording.time_s[-1]),
        rate_hz=recording.rate_hz,
        measured_hz=float(1 / np.median(steps)),
        gaps=gaps,
        noise=rest.std(axis=0).tolist(),
        rest_mean=rest.mean(axis=0).tolist(),
        most=np.abs(recording.gyro).max(axis=0).tolist(),
        gravity=None if accel is None else float(np.median(np.linalg.norm(accel, axis=1))),
        temperature_c=None if warm is None else (float(warm.min()), float(warm.max())),
        notes=recording.notes,
    )


def sentences(of: Findings) -> list[str]:
    """Return the findings as lines of text for the user; rates in °/s."""
    dps = [np.degrees(part) for part in (of.noise, of.rest_mean, of.most)]
    noise, mean, most = (
        ", ".join(f"{axis} {value:.4g}" for axis, value in zip(_AXES, part, strict=True)) for part in dps
    )
    lost = sum(gap.missing for gap in of.gaps)
    at = f", the first of {of.gaps[0].missing} at {of.gaps[0].after_s:.3f} s" if of.gaps else ""
    lines = [
        f"samples:     {of.samples} in {of.duration_s:.3f} s",
        f"rate:        {of.rate_hz:.6g} Hz; the median step is {1 / of.measured_hz:.6g} s",
        f"gaps:        {len(of.gaps)}, {lost} samples missing{at}",
        f"quietest s:  mean {mean} °/s; standard deviation {noise} °/s",
        f"largest:     {most} °/s",
        "gravity:     no accelerometer" if of.gravity is None else f"gravity:     {of.gravity:.4g} m/s², median length",
    ]
    if of.temperature_c is not None:
        lines.append(f"temperature: {of.temperature_c[0]:.1f} to {of.temperature_c[1]:.1f} °C")
    return [*lines, *(f"note:        {words}" for words in of.notes)]
