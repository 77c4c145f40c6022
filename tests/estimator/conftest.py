"""Of most tests of the service: a ward of one device."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.estimator.memory_ward import Ward
from tests.estimator.stream import Stream, calibration


@pytest.fixture
def ward(tmp_path: Path) -> Iterator[Ward]:
    made = Ward(tmp_path)
    yield made
    made.kill()


@pytest.fixture(scope="module")
def once() -> Stream:
    """A device that is calibrated."""
    return calibration(seed=1)
