"""An estimator that is killed under load goes on where it was: calibrations, bias, samples, store."""

from pathlib import Path

import pytest

from tests.conftest import Effort
from tests.ward.killed import killed

pytestmark = [pytest.mark.ward, pytest.mark.soak, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(7200)]


def test_whenever_it_is_killed_nothing_that_was_said_is_lost(tmp_path: Path, effort: Effort) -> None:
    faults = []
    steady, speed = effort(4, 20), effort(10, 1)
    for number, kill in enumerate(killed(tmp_path, effort(2, 200), steady, 1, effort.seed, speed=speed)):
        faults += [f"kill {number}: {fault}" for fault in kill.faults]
    assert faults == []
