"""Merges consecutive batches of one device, because few large messages cost bridge, router and subscribers less."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bridge.wire.codec import MAX_SAMPLES
from bridge.wire.messages import SampleBatch, SampleFlag

T = TypeVar("T", bound="np.generic[Any]")


def merged(batches: Sequence[SampleBatch]) -> list[SampleBatch]:
    """Merge consecutive batches into as few batches as possible, of at most MAX_SAMPLES samples each.

    A gap, a new boot, another tick period or a different set of columns starts a new batch.
    """
    groups: list[list[SampleBatch]] = []
    size = 0
    for batch in batches:
        if groups and size + len(batch) <= MAX_SAMPLES and _goes_on(groups[-1][-1], batch):
            groups[-1].append(batch)
            size += len(batch)
        else:
            groups.append([batch])
            size = len(batch)
    return [_one(group) for group in groups]


def _goes_on(before: SampleBatch, after: SampleBatch) -> bool:
    return (
        after.boot == before.boot
        and after.sequence == before.sequence + len(before)
        and after.tick_period_s == before.tick_period_s
        and not int(after.flags[0]) & SampleFlag.AFTER_GAP
        and (after.accel is None) == (before.accel is None)
        and (after.temperature_c is None) == (before.temperature_c is None)
    )


def _one(group: list[SampleBatch]) -> SampleBatch:
    first, last = group[0], group[-1]
    if first is last:
        return first
    return SampleBatch(
        device=first.device,
        boot=first.boot,
        sequence=first.sequence,
        receive_time_ns=last.receive_time_ns,
        start_time_ns=first.start_time_ns,
        tick_period_s=first.tick_period_s,
        clock_rate=last.clock_rate,
        ticks=np.concatenate([batch.ticks for batch in group]),
        gyro=np.concatenate([batch.gyro for batch in group]),
        accel=column([batch.accel for batch in group]),
        temperature_c=column([batch.temperature_c for batch in group]),
        flags=np.concatenate([batch.flags for batch in group]),
    )


def column(parts: Sequence[NDArray[T] | None]) -> NDArray[T] | None:
    """Concatenate the parts of a column, (n,) or (n, 3) each, along the samples; None if no part has the column."""
    present = [part for part in parts if part is not None]
    return np.concatenate(present) if present else None
