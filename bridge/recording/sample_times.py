"""Sample times of a table's rows: from the file's times, from a sample counter, or from the row number."""

from pathlib import Path

import numpy as np

from bridge.recording.bad_rows import keep_rows, repeated, repeated_without_time
from bridge.recording.clock import ClockFault, mend
from bridge.recording.error import RecordingError
from bridge.recording.plausibility import check_rate, check_time, rate_of
from bridge.recording.reading import Reading
from bridge.recording.recording import Floats
from bridge.terminal.plurals import count

_OTHER_RATE = 0.02  # relative: a stated and a measured rate that differ by more are told to the user
_MOST_REPEATED = 0.1  # largest share of repeated rows; more are no accident


def sample_times(
    path: Path, columns: dict[str, Floats], tick_s: float, rate: float | None, reading: Reading, notes: list[str]
) -> tuple[Floats, list[int]]:
    """Return the time (n,) of each kept row, s, and the index of the first row of each boot.

    columns: as in `Table.columns`; changed in place: rows are sorted by time, and repeated rows dropped.
    tick_s: duration of one count of the file's time column, s; 0 if unknown. rate: sampling rate that the file or the
    user states, Hz, or None. reading: the options given by the user.
    notes: a sentence is added for each repair.
    Raises RecordingError if the times cannot be repaired or are implausible, or if neither times nor a rate are known.
    """
    if "t_s" not in columns:
        return _counted(path, columns, _assumed(path, rate, reading, notes), notes), [0]
    rises = bool((np.diff(columns["t_s"]) > 0).all())
    if not rises and (again := repeated(columns["t_s"], _values(columns))).any():
        notes.append(f"{count(int(again.sum()), 'row')} left out: equal to an earlier row, including the time")
        keep_rows(columns, ~again)
    if len(columns["t_s"]) < 2:
        raise RecordingError(
            f"{path}: the file has {count(len(columns['t_s']), 'distinct row')}; at least 2 are needed"
        )
    repairs = list[str]()
    try:
        mended = mend(columns["t_s"], tick_s, repairs)
    except ClockFault as fault:
        if reading.rate_hz is None:
            raise RecordingError(f"{path}: {fault}") from None
        notes.append(f"the times are replaced by the given rate, {reading.rate_hz:g} Hz: {fault}")
        return _counted(path, columns, reading.rate_hz, notes), [0]
    if not rises:
        keep_rows(columns, mended.order)
    notes += repairs
    time = mended.time
    if reading.rate_hz is not None:
        return _at_told_rate(time, mended.starts, reading.rate_hz, notes, arrival=mended.arrival), mended.starts
    for start, end in zip(mended.starts, [*mended.starts[1:], len(time)], strict=True):
        check_time(path, time[start:end])
        if rate is not None:
            check_rate(path, time[start:end], rate)
            own = rate_of(time[start:end])
            if abs(own / rate - 1) > _OTHER_RATE:
                notes.append(f"the file states {rate:g} Hz, its times give {own:.4g} Hz: the times are used")
    return time, mended.starts


def _assumed(path: Path, rate: float | None, reading: Reading, notes: list[str]) -> float:
    """Return the rate of a file without sample times. Raises RecordingError."""
    if rate is None:
        raise RecordingError(
            f"{path}: the file has neither sample times nor 'rate_hz': give the rate with --rate-hz, or as rate_hz in a ward file"
        )
    if reading.rate_hz is not None:
        notes.append(
            f"there are no sample times: the given {rate:g} Hz is assumed; a wrong rate makes all scale factors wrong"
        )
    return rate


def _values(columns: dict[str, Floats]) -> Floats:
    accel = columns.get("accel_m_s2")
    return columns["gyro_rad_s"] if accel is None else np.hstack([columns["gyro_rad_s"], accel])


def _counted(path: Path, columns: dict[str, Floats], rate: float, notes: list[str]) -> Floats:
    """Return times from a sample counter if there is a usable one, else from row numbers."""
    counter, values = columns.get("counter"), _values(columns)
    counts = counter is not None and len(np.unique(counter)) > len(counter) / 2
    again = repeated(counter, values) if counter is not None and counts else repeated_without_time(values)
    share = float(np.mean(again))
    if share > _MOST_REPEATED:
        raise RecordingError(
            f"{path}: {share:.0%} of the rows repeat an earlier row, and without times truerate cannot tell repeats from new "
            "samples: export the file with times"
        )
    columns["row"] = columns.get("row", np.arange(len(again), dtype=np.float64)) - np.cumsum(again)
    if again.any():
        notes.append(f"{count(int(again.sum()), 'row')} left out: equal to an earlier row in all values")
        keep_rows(columns, ~again)
    rows, counter = columns["row"], columns.get("counter")
    if counter is not None and (by_counter := _numbers(counter)) is not None:
        if (missing := int(by_counter[-1]) + 1 - len(by_counter)) and int(by_counter[-1]) != int(rows[-1] - rows[0]):
            notes.append(f"{count(missing, 'sample')} missing, by the counter")
        rows = by_counter
    return np.asarray((rows - rows[0]) / rate)


def _numbers(counter: Floats) -> Floats | None:
    """Return sample numbers of a counter, wraps undone; None if it does not count samples one by one."""
    if not np.isfinite(counter).all() or (counter != np.rint(counter)).any() or len(counter) < 8:
        return None
    steps = np.diff(counter)
    one = float(np.median(steps))  # packets of other kinds may be counted, too
    if not 1 <= one <= 16:
        return None
    back = steps < 0
    if back.any():
        most = max((1 << bits for bits in (8, 16, 24, 32)), key=lambda m: -abs(m - (counter.max() + 1)))
        steps = np.where(back, steps + most, steps)
    steps = steps / one
    if (steps < 1).any() or steps.max() > 1000 or (steps != np.rint(steps)).any():
        return None
    return np.concatenate([[0.0], np.cumsum(steps)])


def _at_told_rate(time: Floats, starts: list[int], rate_hz: float, notes: list[str], *, arrival: bool) -> Floats:
    """Return times at the rate given by the user; gaps in the file's own times stay gaps."""
    told = np.empty(len(time))
    for start, end in zip(starts, [*starts[1:], len(time)], strict=True):
        steps = np.diff(time[start:end]) * rate_of(time[start:end]) if end - start > 1 else np.empty(0)
        whole = np.ones(len(steps)) if arrival else np.where(steps > 1.75, np.rint(steps), 1.0)
        told[start:end] = np.concatenate([[0.0], np.cumsum(whole)]) / rate_hz
    own = rate_of(time[: starts[1]] if len(starts) > 1 else time)
    doubt = f", far from the {own:.4g} Hz of its times" if abs(own / rate_hz - 1) > 0.1 else ""
    notes.append(f"the times are replaced by the given rate, {rate_hz:g} Hz{doubt}")
    return told
