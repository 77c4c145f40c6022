"""Pulled and plugged in again and again, a device always comes back, leaves nothing behind and disturbs nobody."""

from pathlib import Path

from tests.bench.hotplug import pull


def test_a_device_that_is_pulled_often_always_comes_back(tmp_path: Path) -> None:
    outcome = pull(tmp_path, 20)
    assert len(outcome.back_s) == 20
    assert outcome.files[0] == outcome.files[1]
    assert outcome.threads[0] == outcome.threads[1]
    assert len(outcome.beside) > 20
    assert outcome.beside_unbroken
