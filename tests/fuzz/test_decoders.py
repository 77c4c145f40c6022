"""Four thousand executions of every decoder; `make fuzz` makes ten million each."""

import gc
import tracemalloc

import numpy as np
import pytest

from tests.fuzz.executions import Target, inputs, names
from tests.fuzz.seeds import SEEDS

EXECUTIONS = 4_000
_GROWTH = 300_000  # bytes: a decoder's own bounded buffers, and the interpreter's


def test_every_decoder_is_fuzzed() -> None:
    assert sorted(SEEDS) == names()


@pytest.mark.parametrize("name", names())
def test_a_decoder_takes_its_own_messages(name: str) -> None:
    target = Target(name)
    for _ in range(40):
        for seed in target.seeds:
            target.feed(seed)
    assert target.events > 0


@pytest.mark.parametrize("name", names())
def test_no_bytes_raise_or_are_kept_for_ever(name: str) -> None:
    target = Target(name)
    rng = np.random.default_rng(len(name))
    for data in inputs(target.seeds, rng, EXECUTIONS // 5):
        target.feed(data)
    gc.collect()
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for data in inputs(target.seeds, rng, EXECUTIONS // 20):
        target.feed(data)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < _GROWTH
    for data in inputs(target.seeds, rng, EXECUTIONS - target.executions):
        target.feed(data)
    assert target.executions == EXECUTIONS
    assert target.events > 0
    assert target.faults > 0
