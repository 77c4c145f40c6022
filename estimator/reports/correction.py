"""Report on a corrected recording, as sentences in degrees and as JSON in SI units."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bridge.recording import Recording
from bridge.terminal.plurals import count
from bridge.wire.messages import Quality
from estimator.geometry.gyro_model import AXES, SIGMAS
from estimator.offline.calibration_file import accelerometer_as_json
from estimator.offline.corrected_recording import CorrectedRecording
from estimator.reports.calibration import accelerometer_as_words, as_notes, first

_NONE = "none; give one with --calibration FILE, from `truerate calibrate RECORDING --json > FILE`"
_MEANS = {
    "NONE": "bias unknown or in doubt",
    "PRIOR": "bias unknown or in doubt, scale from another boot",
    "BIAS_ONLY": "bias known, scale not from this boot",
    "GOOD": "calibrated",
    "DEGRADED": "calibrated, but the bias is in doubt",
}


def bias_known(corrected: CorrectedRecording) -> bool:
    """Return whether the bias is known for at least one sample of a corrected recording."""
    return not corrected.seconds().keys() <= {"NONE", "PRIOR"}


def as_json(corrected: CorrectedRecording, recording: Recording, out: Path) -> dict[str, Any]:
    """Return a corrected recording's report as JSON-compatible values, in SI units.

    Keys: samples (their number); duration_s; rate_hz; smoothed; calibration (its id); matrix (3, 3); accelerometer (its
    calibration); seconds_by_quality; temperature_c (lowest, highest); events (counts by name); said and notes (texts).
    bias_rad_s and bias_std_rad_s (3) are those of the last sample. written is `out`, the path of the output file.
    """
    warm = recording.temperature_c
    return {
        "samples": len(corrected),
        "duration_s": float(recording.time_s[-1]),
        "rate_hz": recording.rate_hz,
        "smoothed": corrected.smoothed,
        "calibration": corrected.calibration or None,
        "matrix": corrected.matrix.tolist(),
        "accelerometer": None if corrected.accelerometer is None else accelerometer_as_json(corrected.accelerometer),
        "seconds_by_quality": corrected.seconds(),
        "bias_rad_s": corrected.bias[-1].tolist(),
        "bias_std_rad_s": corrected.bias_std[-1].tolist(),
        "temperature_c": None if warm is None else [float(warm.min()), float(warm.max())],
        "events": corrected.events,
        "said": list(corrected.said),
        "notes": list(recording.notes),
        "written": str(out),
    }


def as_words(corrected: CorrectedRecording, recording: Recording, out: Path) -> Iterator[str]:
    """Yield the lines of a corrected recording's report.

    They state samples, quality, bias at the end (°/s), calibrations, temperature (°C), events, and the output file
    `out`.
    """
    minutes = recording.time_s[-1] / 60
    how = "from the whole recording" if corrected.smoothed else "as in a live ward"
    yield f"{count(len(corrected), 'sample')}, {minutes:.1f} min at {recording.rate_hz:.4g} Hz, corrected {how}"
    yield "quality: " + ", ".join(
        f"{name} {_span(seconds)} ({_MEANS[name]})" for name, seconds in corrected.seconds().items()
    )
    bias, wide = np.degrees(corrected.bias[-1]), SIGMAS * np.degrees(corrected.bias_std[-1])
    if bias_known(corrected):
        each = (f"{AXES[i]} {bias[i]:+.4f} ± {wide[i]:.4f}" for i in range(3))
        yield f"bias at the end: {', '.join(each)} °/s (95 %)"
    else:
        scale = "The scale is corrected by another boot's calibration." if "PRIOR" in corrected.seconds() else ""
        yield f"The bias is not corrected: the recording has no rest of 2 s. {scale or 'The scale is not corrected either.'}"
        yield "Record again with the device lying still for 3 s, or give a calibration of this boot with --calibration FILE."
    yield f"calibration: {corrected.calibration or _NONE}"
    yield from accelerometer_as_words(corrected.accelerometer)
    if (warm := recording.temperature_c) is not None:
        yield f"temperature: {warm.min():.1f} to {warm.max():.1f} °C"
    if corrected.quality[-1] == Quality.DEGRADED:
        yield "the bias is in doubt at the end; if the device was switched off after the calibration, give --other-boot"
    if corrected.events:
        yield "events: " + ", ".join(f"{name}: {n}" for name, n in sorted(corrected.events.items()))
    yield from as_notes(recording.notes)
    yield f"written: {out}"


def said(corrected: CorrectedRecording) -> Iterator[str]:
    """Yield the first 12 messages that a live estimator would have logged, then a line that counts the others."""
    yield from first(corrected.said)


def _span(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"
