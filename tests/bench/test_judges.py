"""The benches see what they judge: what is missing, what is late, and what is not as it was."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch
from tests.bench import access, cluster
from tests.bench.load.stream import WARD
from tests.bridge.wire.examples import FIXED
from tests.ward.killed import KEPT_S, Holes, discontinued


def batch(sequence: int, bias_std_dps: float = 0.01) -> CorrectedBatch:
    """Three samples at 100 Hz, of a bias that is known to so much."""
    return replace(
        FIXED,
        sequence=sequence,
        ticks=np.arange(sequence, sequence + 3, dtype=np.uint64) * np.uint64(10_000),
        bias_std=np.full(3, np.radians(bias_std_dps), np.float32),
    )


def test_what_is_lost_before_a_kill_counts_at_the_next_question() -> None:
    holes = Holes()
    holes.take(batch(0), 1.0)
    assert holes.new() == []
    holes.take(batch(5), 2.0)  # while nobody asks
    holes.take(batch(8), 3.0)
    assert holes.new() == ["d1: 2 samples never came"]
    assert holes.new() == [], "told once"
    holes.take(batch(30), 3.0 + KEPT_S)
    assert holes.new() == [], "bridges keep no more than that"


@pytest.mark.parametrize(
    ("std_dps", "later_s", "faults"), [(0.012, 0.0, 0), (0.1, 0.0, 1), (0.03, 0.0, 1), (0.03, 60.0, 0)]
)
def test_a_bias_that_is_known_worse_than_it_walked_was_not_gone_on_with(
    std_dps: float, later_s: float, faults: int
) -> None:
    found = discontinued("d", batch(0), np.radians([0.01, 0.01, 0.01]), batch(3 + round(100 * later_s), std_dps))
    assert len(found) == faults
    assert all("as if little had been kept" in fault for fault in found)


def test_a_device_that_is_silent_to_the_end_is_a_fault_and_a_gap() -> None:
    came = [(0.03 * number, [message("a", 3 * number)]) for number in range(100)]
    came += [(0.03 * number, [message("b", 3 * number)]) for number in range(10)]
    given = cluster.Given(sorted(came, key=lambda one: one[0]))
    assert given.silent(3) == 2, "b, and one that was never heard"
    assert (given.gaps({"a", "b"}, since=1.0, for_s=0.5) > 0.1).tolist() == [False, True]


def message(device: str, sequence: int) -> Message:
    """What comes of a device."""
    payload = codec.encode_corrected(replace(batch(sequence), device=device))
    return Message(keys.build(WARD, "corrected", device=device), payload)


def test_a_surplus_in_one_cell_hides_no_lack_in_another() -> None:
    expected = Counter({("bridge:b1", "raw"): 10, ("viewer:v1", "status"): 10})
    found = Counter({("bridge:b1", "raw"): 13, ("viewer:v1", "status"): 7, ("viewer:v1", "raw"): 1})
    assert access.judged(found, expected) == (3, 3, 1)
    assert access.judged(expected, expected) == (0, 0, 0)
