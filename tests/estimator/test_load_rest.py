"""What an estimator loads while it serves already."""

import sys

import pytest

from estimator.service import serve


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
