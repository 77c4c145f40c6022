"""Repairs sample times: counter wraps, swapped rows, single bad times, coarse clocks, arrival times; finds reboots.

Each fault has its own detector and its own message to the user. Times without a fault are left unchanged.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.recording.bad_rows import interpolated
from bridge.recording.recording import TICK_S, Floats
from bridge.terminal.plurals import count

Indices = NDArray[np.intp]
_COUNTERS = tuple(float(1 << bits) for bits in (16, 24, 31, 32))
#: longest step over a counter wrap, in usual steps; farthest a swapped row may be from its place, in rows
_NEAR, _FAR = 20.0, 64
#: longest run of bad times that is repaired
_BAD_RUN = 3
#: steps shorter than this share of the mean are within a bunch; with more than this share of them, times are of arrival
_SHORT, _BUNCHED = 0.3, 0.1
#: seconds within which at least one sample is taken to arrive without delay
_STALL_S = 1.0
#: largest distance of arrival times from their line, in longest usual steps; beyond it samples are missing
_OFF_LINE = 2.5
_LEAST_PARTS_ROWS = 10
#: ticks: a longer step is a gap; a time this near to a line is on it. Samples on either side of a running mean
_GAP, _ON_LINE, _AROUND = 5.0, 1.5, 16
_MOST_PARTS = 50
_ARRIVAL = "the times are arrival times, in bursts: truerate spaces the samples evenly"


class ClockFault(Exception):
    """Sample times cannot be repaired; the message describes the fault and what to do."""


class Mended(NamedTuple):
    """Repaired sample times of a recording.

    order (m,): row indices, in order of time. time (m,): s, rising within each boot. starts: index into `time` of each
    boot's first row. arrival: True if the file's times were those of data arriving in bursts, not of sampling.
    """

    order: Indices
    time: Floats
    starts: list[int]
    arrival: bool = False


def mend(time: Floats, tick_s: float, notes: list[str]) -> Mended:
    """Repair the sample times (n,) of a recording, s, NaN where a time is missing; find reboots.

    Repaired faults: counter wraps, swapped rows, single bad times, coarse clocks, and times of arrival.
    tick_s: duration of one count of the file's time column, s; 0 if unknown.
    notes: a sentence is added for each repair.
    Raises ClockFault if the times cannot be repaired.
    """
    order = np.arange(len(time))
    time = _filled(time, notes)
    if (np.diff(time) > TICK_S / 2).all() and not _is_bunched(time):
        return Mended(order, _outliers_mended(time, notes), [0])
    time = _unwrapped(time, tick_s, notes)
    order, time = _sorted(order, time, notes)
    time = _outliers_mended(time, notes)
    back = np.flatnonzero(np.diff(time) < 0) + 1
    starts = [0, *back.tolist()]
    lengths = np.diff([*starts, len(time)])
    if len(starts) > 1 and (len(starts) > _MOST_PARTS or int(lengths.min()) < _LEAST_PARTS_ROWS):
        raise ClockFault(
            f"{count(len(back), 'time')} in the column below the previous time, first from {time[back[0] - 1]:.10g} to "
            f"{time[back[0]]:.10g} s. No counter wrap, swapped rows or reboot explains this. Export the file again, or choose "
            "another column with --time-column NAME"
        )
    spaced = [_spaced(part) for part in np.split(time, starts[1:])]
    said = [note for _, note in spaced if note]
    notes += dict.fromkeys(said)
    return Mended(order, np.concatenate([part for part, _ in spaced]), starts, _ARRIVAL in said)


def _filled(time: Floats, notes: list[str]) -> Floats:
    bad = ~np.isfinite(time)
    if not bad.any():
        return time
    if np.count_nonzero(~bad) < 2:
        raise ClockFault(
            "the time column holds no readable time: give the device's rate with --rate-hz, or another --time-column"
        )
    notes.append(f"{count(int(bad.sum()), 'time')} missing, interpolated")
    return interpolated(time, ~bad)


def _unwrapped(time: Floats, tick_s: float, notes: list[str]) -> Floats:
    steps = np.diff(time)
    usual = float(np.median(steps))
    if not tick_s or usual <= 0:
        return time
    for most in _COUNTERS:
        over = steps + most * tick_s
        wraps = (steps < 0) & (over > 0) & (over < _NEAR * usual)
        if wraps.any():
            notes.append(f"the counter wrapped {count(int(wraps.sum()), 'time')} at {most:.0f}: undone")
            time = time.copy()
            time[1:] += np.cumsum(wraps) * most * tick_s
            return time
    return time


def _sorted(order: Indices, time: Floats, notes: list[str]) -> tuple[Indices, Floats]:
    """Sort rows by time if a few are out of place, near their place, and sorting crowds no two rows together."""
    if (np.diff(time) >= 0).all():
        return order, time
    by_time = np.argsort(time, kind="stable")
    moved = np.abs(by_time - order)
    steps = np.diff(time[by_time])
    usual = float(np.median(steps))
    back = np.flatnonzero(np.diff(time) < 0)
    # Sorting a bad time would crowd the rows around its new place and leave a gap at the old one.
    near = [float(steps[max(0, at - _FAR) : at + _FAR].min()) for at in back[:1000]]
    if int(moved.max()) <= _FAR and usual > 0 and min(near) > usual / 2:
        notes.append(f"{count(int(np.count_nonzero(np.diff(time) < 0)), 'row')} out of order: sorted by time")
        return by_time, time[by_time]
    return order, time


def _outliers_mended(time: Floats, notes: list[str]) -> Floats:
    """Interpolate the times of short runs of rows that lie outside the evenly spaced times around them."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    if usual <= 0 or len(time) < 8:
        return time
    bad = np.zeros(len(time), bool)
    for run in range(1, _BAD_RUN + 1):
        across = time[run + 1 :] - time[: -run - 1]
        even = np.abs(across - (run + 1) * usual) < 0.75 * usual
        for at in np.flatnonzero(even & ((steps[:-run] < 0) | (steps[run:] < 0))):
            inside = time[at + 1 : at + 1 + run]
            if not bad[at] and not bad[at + run + 1] and ((inside <= time[at]) | (inside >= time[at + run + 1])).all():
                bad[at + 1 : at + 1 + run] = True
    if steps[0] < 0 or (steps[0] > 1000 * usual and np.abs(steps[1:7] - usual).max() < usual):
        bad[0] = True
    if not bad.any():
        return time
    notes.append(f"{count(int(bad.sum()), 'bad time')}, outside the neighbouring times, interpolated")
    mended = interpolated(time, ~bad)
    if bad[0]:
        mended[0] = mended[1] - usual
    return mended


def _is_bunched(time: Floats) -> bool:
    steps = np.diff(time)
    mean = float(steps.mean())
    return len(steps) > 20 and float(np.mean(steps < _SHORT * mean)) > _BUNCHED and _crowded(steps)


def _crowded(steps: Floats) -> bool:
    """Return whether short steps lie between long ones, as in bunches, rather than around a few long pauses."""
    usual = float(np.quantile(steps, 0.9))
    longest = steps[steps > 5 * usual]
    mean = float((steps.sum() - longest.sum()) / max(1, len(steps) - len(longest)))
    return float(np.mean(steps < _SHORT * mean)) > _BUNCHED


def _spaced(time: Floats) -> tuple[Floats, str]:
    """Return rising times of one boot, and a note on what was repaired.

    Good times are unchanged; coarse times and times of arrival are put on a line.
    """
    steps = np.diff(time)
    distinct = int(np.count_nonzero(steps > 0)) + 1
    if len(time) < 2:
        return time, ""
    if (distinct < 3 and distinct < len(time)) or (distinct < 8 and len(time) > 4 * distinct):
        raise ClockFault(
            f"the times are rounded: only {distinct} different times in {count(len(time), 'row')}; export them with more digits, "
            "or give the device's rate with --rate-hz"
        )
    stands = float(np.mean(steps <= TICK_S / 2))
    if not stands and not _is_bunched(time):
        return time, ""
    if stands and _is_coarse(time):
        return _ticks_spread(time), "the clock is coarse: samples with equal times are spread evenly"
    return _on_a_line(time), _ARRIVAL


def _is_coarse(time: Floats) -> bool:
    """Return whether times are whole multiples of a tick, and the ticks hold equally many samples, give or take one."""
    ticks, held = np.unique(time, return_counts=True)
    tick = float(np.median(np.diff(ticks)))
    middle = np.diff(ticks)
    whole = np.abs(middle / tick - np.rint(middle / tick)) < 0.05
    return bool(
        np.mean(whole) > 0.95 and np.ptp(np.quantile(held[1:-1], [0.02, 0.98])) <= max(1.0, 0.2 * np.median(held))
    )


def _ticks_spread(time: Floats) -> Floats:
    """Spread times (n,) that repeat within a clock tick evenly up to the next tick; gaps stay."""
    ticks, first, held = np.unique(time, return_index=True, return_counts=True)
    to_next = np.append(np.diff(ticks), np.inf)
    usual = float(np.median(to_next[:-1])) if len(ticks) > 1 else 0.0
    middle = float(np.median(held[1:-1])) if len(held) > 2 else float(held.max())
    each = np.minimum(to_next, usual) / np.maximum(held, 1)
    each[0] = each[-1] = usual / max(middle, 1.0)
    within = np.arange(len(time)) - np.repeat(first, held)
    # The first tick may be cut off by the recording's start: its samples are the tick's last ones.
    within[: held[0]] += round(max(0.0, middle - held[0]))
    spread = np.repeat(ticks, held) + within * np.repeat(each, held)
    return _smoothed(spread, usual)


def _smoothed(time: Floats, tick: float) -> Floats:
    """Space times evenly between gaps: the device's rate is steady even if the number of samples per tick is not."""
    step = float(np.median(np.diff(time)))
    edges = np.flatnonzero(np.diff(time) > _GAP * max(tick, step)) + 1
    return np.concatenate([_evened(part, tick) for part in np.split(time, edges)])


def _evened(time: Floats, tick: float) -> Floats:
    """Put gapless times (n,) on a line; for an uneven clock, add a running mean of their distance from the line."""
    n = len(time)
    if n < 2 * _AROUND:
        return time
    slope, start = np.polyfit(np.arange(n), time, 1)
    line = start + slope * np.arange(n)
    if np.abs(line - time).max() < _ON_LINE * tick:
        return np.asarray(line)
    around = np.convolve(
        np.pad(time - line, _AROUND, mode="edge"), np.full(2 * _AROUND + 1, 1 / (2 * _AROUND + 1)), "valid"
    )
    mean = line + around
    rises = bool((np.diff(mean) > 0).all())
    return mean if rises and np.abs(mean - time).max() < _AROUND * tick else time


def _on_a_line(time: Floats) -> Floats:
    """Fit evenly spaced times through times of arrival, which are late by their bunch's delay. Raises ClockFault."""
    n = len(time)
    rows = np.arange(n)
    wait = float(np.quantile(np.diff(time), 0.98))
    window = min(max(16, round(_STALL_S * (n - 1) / max(time[-1] - time[0], TICK_S))), max(2, n // 4))
    since = time - time[0]
    slope, start = np.polyfit(rows, since, 1)
    for _ in range(2):  # the samples with the least delay in each window are on the device's line
        late = since - slope * rows
        least = [at + int(np.argmin(late[at : at + window])) for at in range(0, n - window + 1, window)]
        slope, start = np.polyfit(rows[least], since[least], 1)
    off = since[least] - (start + slope * rows[least])
    if np.abs(off).max() > _OFF_LINE * wait:
        raise ClockFault(
            f"the times are arrival times, and samples are missing: evenly spaced times would be wrong by up to "
            f"{np.abs(off).max():.2g} s, and so would the scale factors. Record the device's own time or counter"
        )
    return np.asarray(time[0] + start + slope * rows)
