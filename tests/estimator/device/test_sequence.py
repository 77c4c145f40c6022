from collections.abc import Iterable

import numpy as np
import pytest

from estimator.device.samples import Samples
from estimator.device.sequence import Sequence
from tests.estimator.stream import Stream, stream


@pytest.fixture(scope="module")
def source() -> Stream:
    return stream([], 3.0)


def begun(boot: int = 1) -> Sequence:
    sequence = Sequence()
    sequence.begin(boot)
    return sequence


def take(sequence: Sequence, source: Stream, parts: Iterable[tuple[int, int]], boot: int = 1) -> list[int]:
    used: list[int] = []
    for start, end in parts:
        batch = Samples.of(*source.part(start, end).batches([], boot=boot, first=start))
        first = sequence.fresh(batch)
        assert 0 <= first <= batch.n
        used += range(start + first, end)
    assert sequence.samples_in == sequence.samples_out + sequence.dropped.total()
    return used


def test_samples_in_order_are_all_new(source: Stream) -> None:
    sequence = begun()
    assert take(sequence, source, [(0, 10), (10, 20), (20, 21)]) == list(range(21))
    assert sequence.dropped.as_dict() == sequence.events.as_dict() == {}
    assert sequence.seen == 21


def test_the_first_number_heard_is_no_gap(source: Stream) -> None:
    sequence = begun()
    take(sequence, source, [(150, 160)])
    assert sequence.events.as_dict() == {}
    assert sequence.seen == 10


def test_repeats_overlaps_and_gaps(source: Stream) -> None:
    sequence = begun()
    used = take(sequence, source, [(0, 10), (0, 10), (5, 15), (3, 8), (20, 30), (15, 20), (25, 40)])
    assert used == [*range(15), *range(20, 40)]
    assert sequence.dropped.as_dict() == {"duplicate": 10 + 5 + 5 + 5 + 5}
    assert sequence.events.as_dict() == {"gaps": 1, "missing_samples": 5}
    assert sequence.seen == 40


def test_boots_of_before_are_asked_for_once_another_than_the_present_one_comes(source: Stream) -> None:
    sequence, asked = begun(3), []

    def before() -> list[int]:
        asked.append(True)
        return [1, 2]

    sequence.recall(before)
    take(sequence, source, [(0, 10)], boot=3)
    assert not sequence.is_new_boot(3)
    assert not asked
    assert sequence.is_new_boot(4)
    sequence.begin(4)
    assert [sequence.is_new_boot(boot) for boot in (1, 2, 3, 4, 5)] == [False, False, False, False, True]
    batch = Samples.of(*source.part(0, 10).batches([], boot=3, first=0))
    assert not sequence.follows(batch), "how far the one before had come is not forgotten"
    assert len(asked) == 1


def test_boots_of_before_that_cannot_be_told_now_are_asked_for_again() -> None:
    sequence, told = begun(3), list[list[int] | None]([None, [2]])
    sequence.recall(lambda: told.pop(0))
    assert sequence.is_new_boot(2)
    assert not sequence.is_new_boot(2)
    assert sequence.is_new_boot(1)
    assert not told


def test_a_session_that_is_begun_anew_asks_for_boots_of_before_as_well() -> None:
    sequence = begun(3)
    sequence.recall(lambda: [2])
    assert not sequence.anew(0, 0).is_new_boot(2)


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


def test_a_jump_is_no_gap_of_known_size(source: Stream) -> None:
    sequence = begun()
    take(sequence, source, [(0, 10)])
    far = Samples.of(*source.part(10, 20).batches([], first=2**61))
    sequence.jump(far)
    assert sequence.fresh(far) == 0
    assert sequence.events.as_dict() == {"stream jumped": 1}
    assert sequence.seen == 20


def test_begun_anew_the_counts_stay_and_what_was_lost_is_counted(source: Stream) -> None:
    sequence = begun()
    take(sequence, source, [(0, 20)])
    sequence.begin(2)
    take(sequence, source, [(0, 10)], boot=2)
    after = sequence.anew(10, 5)
    assert (after.samples_in, after.samples_out, after.dropped.as_dict()) == (35, 20, {"session failed": 15})
    assert after.is_new_boot(2)
    assert not after.is_new_boot(1)


def test_only_so_many_boots_are_remembered() -> None:
    sequence = Sequence()
    for boot in range(100):
        sequence.begin(boot)
    assert sequence.is_new_boot(1)
    assert not sequence.is_new_boot(98)


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
