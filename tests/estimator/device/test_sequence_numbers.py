from collections.abc import Iterable

import numpy as np
import pytest

from estimator.device.sequence_numbers import SequenceNumbers
from estimator.samples.sample_buffer import Samples
from tests.estimator.stream import Stream, stream


@pytest.fixture(scope="module")
def source() -> Stream:
    return stream([], 3.0)


def begun(boot: int = 1) -> SequenceNumbers:
    sequence = SequenceNumbers()
    sequence.begin(boot)
    return sequence


def take(sequence: SequenceNumbers, source: Stream, parts: Iterable[tuple[int, int]], boot: int = 1) -> list[int]:
    used: list[int] = []
    for start, end in parts:
        batch = Samples.of(*source.part(start, end).batches([], boot=boot, first=start))
        first = sequence.fresh(batch)
        assert 0 <= first <= batch.n
        used += range(start + first, end)
    assert sequence.samples_in == sequence.samples_out + sequence.dropped.total()
    return used


def test_repeats_overlaps_and_gaps(source: Stream) -> None:
    sequence = begun()
    used = take(sequence, source, [(0, 10), (0, 10), (5, 15), (3, 8), (20, 30), (15, 20), (25, 40)])
    assert used == [*range(15), *range(20, 40)]
    assert sequence.dropped.as_dict() == {"duplicate": 10 + 5 + 5 + 5 + 5}
    assert sequence.events.as_dict() == {"gaps": 1, "missing_samples": 5}
    assert sequence.seen == 40


def test_what_comes_late_of_an_old_boot_is_dropped_and_counted(source: Stream) -> None:
    sequence = begun(1)
    take(sequence, source, [(0, 10)])
    assert sequence.is_new_boot(2)
    sequence.begin(2)
    assert not sequence.is_new_boot(1)
    assert not sequence.is_new_boot(2)
    assert take(sequence, source, [(10, 20)], boot=1) == []
    assert sequence.dropped.as_dict() == {"old_boot": 10}
    assert take(sequence, source, [(0, 10)], boot=2) == list(range(10))


def test_a_boot_of_the_past_can_begin_again(source: Stream) -> None:
    sequence = begun(1)
    take(sequence, source, [(0, 20)])
    sequence.begin(2)
    old = Samples.of(*source.part(0, 10).batches([], boot=1))
    further = Samples.of(*source.part(20, 30).batches([], boot=1, first=20))
    assert sequence.follows(further)
    assert not sequence.follows(old)
    sequence.begin(1)
    assert not sequence.is_new_boot(2)
    assert take(sequence, source, [(20, 30)]) == list(range(20, 30))


def test_it_is_exactly_once_whatever_comes(source: Stream) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        sequence = begun()
        parts = [(int(a), int(a + n)) for a, n in zip(rng.integers(0, 200, 60), rng.integers(1, 40, 60), strict=True)]
        used = take(sequence, source, parts)
        assert used == sorted(set(used))
        first = parts[0][0]
        assert sequence.seen - sequence.events.as_dict().get("missing_samples", 0) == len(used)
        assert used[0] == first
