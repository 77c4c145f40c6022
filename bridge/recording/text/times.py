"""Parser of times written as text: ISO 8601, dates in any order with a time of day, or a time of day alone."""

import re

import numpy as np

from bridge.recording.recording import Floats

_CLOCK = re.compile(r"(\d{1,2})[:h](\d{2})[:m](\d{2})(?:[.,:](\d+))?\s*([AaPp][Mm])?")
DAY_S = 86_400.0


def is_clock(cell: str) -> bool:
    """Return True if a cell contains a time of day, such as 10:15:00.25 or 3:15:00 PM."""
    return _CLOCK.search(cell) is not None


def seconds_of(cells: list[str]) -> Floats:
    """Convert times of day, as texts, to seconds (n,) since the midnight before the first time.

    The result is NaN for a cell without a time. A step back of more than half a day means that midnight has passed. A
    step ahead of more than half a day means that the row belongs to the day before.
    """
    time = np.array([_second(cell) for cell in cells], np.float64)
    steps = np.diff(time)
    days = np.cumsum((steps < -DAY_S / 2).astype(float) - (steps > DAY_S / 2))
    if days.any():
        time[1:] += days * DAY_S
    return time


def _second(cell: str) -> float:
    match = _CLOCK.search(cell)
    if match is None:
        return np.nan
    hours, minutes, seconds, part, half = match.groups()
    hour = int(hours) % 12 + 12 * (half in {"PM", "pm", "Pm"}) if half else int(hours)
    return hour * 3600 + int(minutes) * 60 + int(seconds) + (float(f"0.{part}") if part else 0.0)
