"""The benches see what they judge: what is missing, what is late, and what is not as it was."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch
from tests.bench import access, cluster, suffering
from tests.bench.load.__main__ import CROWD, QUICKEST, ratios
from tests.bench.load.__main__ import unreached as unreached_by_load
from tests.bench.load.run import Middle, Took
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
    assert given.faults("a")["silent to the end"] == 0
    assert given.faults(["a", "b", "never heard"])["silent to the end"] == 2
    assert (given.gaps({"a", "b"}, since=1.0, for_s=0.5) > 0.1).tolist() == [False, True]


def message(device: str, sequence: int) -> Message:
    """What comes of a device."""
    payload = codec.encode_corrected(replace(batch(sequence), device=device))
    return Message(keys.build(WARD, "corrected", device=device), payload)


@pytest.mark.parametrize(
    ("trouble", "hole_s", "p99_s", "lost", "says"),
    [
        ("flood", 0.3, 0.009, 0, ""),
        ("flood", 0.1, 0.011, 0, "flood: p99 2.20 times that of none (goal 2)"),
        ("frozen raw", 0.2, 0.1, 0, "frozen raw: a hole of 200 ms (goal 150)"),
        ("slow disk", 0.2, 0.1, 3, "slow disk: 3 samples lost (goal 0)"),
    ],
)
def test_who_suffers_too_much_is_named(trouble: str, hole_s: float, p99_s: float, lost: int, says: str) -> None:
    found = {
        "none": suffering.Suffered(0.001, 0.005, 0.01, 0.01, 0.06, 0, ""),
        trouble: suffering.Suffered(0.001, p99_s, 0.01, 0.01, hole_s, lost, ""),
    }
    assert "; ".join(suffering.unreached(found)) == says


def took(seconds: float = 1.0, **other: float) -> Took:
    """A run of a thousand messages."""
    values = {"lost": 0, "cpu": 0.4, "warm_rss_mb": 800.0, "rss_mb": 810.0, "p50_s": 0.002, "p99_s": 0.003, **other}
    return Took(sent=1000, seconds=seconds, twice=0, router_cpu=0.1, sender_late_s=0.0, whole=0, **values)  # type: ignore[arg-type]


def test_what_a_load_takes_is_held_against_its_goals() -> None:
    bare, estimator = Middle.RELAY, Middle.ESTIMATOR
    found = {(QUICKEST, bare): took(), (QUICKEST, estimator): took(p50_s=0.0022), (CROWD, estimator): took()}
    assert unreached_by_load(found, warm_s=300.0) == []
    found |= {(QUICKEST, estimator): took(p99_s=0.005), (CROWD, estimator): took(cpu=0.6, rss_mb=900.0, lost=3)}
    assert unreached_by_load(found, warm_s=300.0) == [
        "100 x 104 Hz: p99 2.00 ms after the bare relay's (goal 1.5)",
        "1000 x 104 Hz: 3 samples lost (goal 0)",
        "1000 x 104 Hz: 60 % of a core (goal 50)",
        "1000 x 104 Hz: memory grew from 800 to 900 MB (goal 2%)",
    ]


def test_messages_a_second_are_compared_within_a_turn() -> None:
    slow_and_fast = [[took(1.0), took(2.0)], [took(0.1), took(0.2)], [took(0.2), took(0.2)]]
    assert ratios(slow_and_fast) == [0.5]


def test_a_surplus_in_one_cell_hides_no_lack_in_another() -> None:
    expected = Counter({("bridge:b1", "raw"): 10, ("viewer:v1", "status"): 10})
    found = Counter({("bridge:b1", "raw"): 13, ("viewer:v1", "status"): 7, ("viewer:v1", "raw"): 1})
    assert access.judged(found, expected) == (3, 3, 1)
    assert access.judged(expected, expected) == (0, 0, 0)
