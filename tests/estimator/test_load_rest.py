"""What an estimator loads while it serves already."""

import gc
import sys

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
    serve._load_rest()
    assert meanwhile_s
    assert max(meanwhile_s) < 1e-3
    assert sys.getswitchinterval() == usual_s


def test_a_part_that_cannot_be_loaded_leaves_python_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    usual_s = sys.getswitchinterval()

    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(serve, "import_module", missing)
    with pytest.raises(ImportError):
        serve._load_rest()
    assert sys.getswitchinterval() == usual_s


def test_the_search_for_cycles_is_rarer_the_more_devices_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    told = list[tuple[int, ...]]()
    monkeypatch.setattr(gc, "set_threshold", lambda *thresholds: told.append(thresholds))
    for devices in (0, 100, 1000):
        serve.collect(devices)
    assert [first for first, *_ in told] == [5_000, 5_000, 50_000]


def test_who_tends_a_service_is_told_how_many_devices_it_has(
    ward: Ward, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = list[int]()
    monkeypatch.setattr(ward.service, "_tend", told.append)
    ward.send(once.batches()[:5], info(1))
    ward.latest()
    assert told[-1] == 1
