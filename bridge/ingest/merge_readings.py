"""Merges consecutive readings of one device, so that the intake needs fewer calls. No I/O.

The time of such a call hardly depends on the number of samples.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from bridge.drivers.driver import Event, Readings
from bridge.ingest.merge_batches import column

_LONGEST_NS = 100_000_000  # the clock fit needs several receive times a second


def joined(events: Iterable[Event]) -> list[Event]:
    """Return the events in the same order, with Readings that follow each other without a gap merged into one.

    Readings are merged if their receive times differ by at most 100 ms. The merged ones get the last receive time.
    """
    groups: list[list[Event]] = []
    for event in events:
        if groups and _goes_on(groups[-1], event):
            groups[-1].append(event)
        else:
            groups.append([event])
    return [
        group[0] if len(group) == 1 else _one([part for part in group if isinstance(part, Readings)])
        for group in groups
    ]


def _goes_on(group: list[Event], event: Event) -> bool:
    first, last = group[0], group[-1]
    return (
        isinstance(event, Readings)
        and isinstance(first, Readings)
        and isinstance(last, Readings)
        and event.boot == last.boot
        and event.sequence == last.sequence + len(last.ticks)
        and 0 <= event.receive_time_ns - first.receive_time_ns <= _LONGEST_NS
        and (event.accel is None) == (last.accel is None)
        and (event.temperature_c is None) == (last.temperature_c is None)
    )


def _one(parts: list[Readings]) -> Readings:
    first, last = parts[0], parts[-1]
    return Readings(
        boot=first.boot,
        sequence=first.sequence,
        receive_time_ns=last.receive_time_ns,
        ticks=np.concatenate([part.ticks for part in parts]),
        gyro=np.concatenate([part.gyro for part in parts]),
        accel=column([part.accel for part in parts]),
        temperature_c=column([part.temperature_c for part in parts]),
        clipped=_clipped(parts),
    )


def _clipped(parts: list[Readings]) -> NDArray[np.bool_] | None:
    if all(part.clipped is None for part in parts):
        return None
    return np.concatenate([np.zeros(len(p.ticks), np.bool_) if p.clipped is None else p.clipped for p in parts])
