"""What an estimator loads while it serves already."""

import gc
import sys
import weakref
from collections.abc import Iterator

import pytest

from estimator.service import serve
from tests.estimator.memory_ward import Ward
from tests.estimator.stream import Stream, info


def test_who_loads_what_calibrations_need_lets_the_service_in_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    usual_s, meanwhile_s = sys.getswitchinterval(), list[float]()

    def noted(name: str) -> None:
        assert name.startswith("scipy.")
        meanwhile_s.append(sys.getswitchinterval())

    monkeypatch.setattr(serve, "import_module", noted)
    serve.load_rest()
    assert meanwhile_s
    assert max(meanwhile_s) < 1e-3
    assert sys.getswitchinterval() == usual_s


def test_a_part_that_cannot_be_loaded_leaves_python_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    usual_s = sys.getswitchinterval()

    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(serve, "import_module", missing)
    with pytest.raises(ImportError):
        serve.load_rest()
    assert sys.getswitchinterval() == usual_s


@pytest.fixture
def searched() -> Iterator[list[int]]:
    """Generations that were searched for cycles."""
    found, before = list[int](), gc.get_threshold()

    def note(phase: str, about: dict[str, int]) -> None:
        if phase == "start":
            found.append(about["generation"])

    gc.collect()
    gc.callbacks.append(note)
    yield found
    gc.callbacks.remove(note)
    gc.set_threshold(*before)
    gc.unfreeze()


def test_what_has_lived_for_a_second_is_not_searched_for_cycles(searched: list[int]) -> None:
    cycles, kept = serve.Cycles(), list[list[int]]()
    cycles.tend(1000)
    searched.clear()
    for _ in range(30):
        kept += [[] for _ in range(90_000)]
        cycles.tend(1000)
    assert not searched
    kept += [[] for _ in range(110_000)]
    assert searched, "so much within a second may be cycles"


def test_all_there_is_is_searched_when_it_has_become_more(searched: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    class Cycle:
        def __init__(self) -> None:
            self.itself = self

    monkeypatch.setattr(serve, "_LOOK_S", 10)
    cycles, kept = serve.Cycles(), list[list[int]]()
    leaked = weakref.ref(Cycle())
    for _ in range(29):
        cycles.tend(10_000)
    assert leaked() is not None
    assert not searched
    kept += [[] for _ in range(gc.get_freeze_count() // 3)]
    cycles.tend(10_000)
    for _ in range(9):
        cycles.tend(10_000)
    assert leaked() is None
    assert searched == [2]
    for _ in range(20):
        cycles.tend(10_000)
    assert searched == [2], "and not again"


def test_who_tends_a_service_is_told_how_many_devices_it_has(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = list[int]()
    monkeypatch.setattr(ward.service, "_tend", told.append)
    ward.send(once.batches()[:5], info(1))
    ward.latest()
    assert told[-1] == 1
