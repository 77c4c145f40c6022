"""Readings that are made one hold the same samples, and nothing is joined that does not go on."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bridge.drivers.driver import Battery, Event, Identity, Readings
from bridge.ingest.intake import Intake
from bridge.ingest.merge_batches import merged
from bridge.ingest.merge_readings import joined
from bridge.wire.messages import BootCause

HELLO = Identity(7, BootCause.POWER_UP, "m", "f", 100.0, 0.0, 1e-6, True, False)


def said(sequence: int, n: int = 2, **changed: Any) -> Readings:
    number = sequence + np.arange(n)
    ticks = (number * 10_000).astype(np.uint32)
    gyro = np.repeat(number[:, None], 3, axis=1) * 1e-3
    return replace(Readings(7, sequence, 10**18 + (sequence + n) * 10**7, ticks, gyro, gyro * 2, None), **changed)


def test_a_run_becomes_one_and_comes_out_of_the_door_the_same() -> None:
    events: list[Event] = [HELLO, said(0), said(2), said(4, 1)]
    hello, one = joined(events)
    assert hello is HELLO
    assert isinstance(one, Readings)
    assert (one.sequence, len(one.ticks), one.receive_time_ns) == (0, 5, said(4, 1).receive_time_ns)
    apart, together = Intake("d", "b", "x", "y"), Intake("d", "b", "x", "y")
    (whole,) = [batch for event in (hello, one) for batch in together.take(event)]
    (parts,) = merged([batch for event in events for batch in apart.take(event)])
    for name in ("ticks", "gyro", "accel", "flags"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name))


@pytest.mark.parametrize(
    "after",
    [
        said(3),
        said(1),
        said(2, boot=8),
        said(2, accel=None),
        said(2, temperature_c=np.zeros(2)),
        said(2, receive_time_ns=10**18 + 10**9),
        said(2, receive_time_ns=10**18),
        Battery(50.0),
        HELLO,
    ],
)
def test_what_does_not_go_on_stays_apart(after: Any) -> None:
    before = said(0)
    assert joined([before, after]) == [before, after]
