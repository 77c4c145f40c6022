"""A device that was calibrated."""

import pytest

from tests.estimator.device.session.lives import worn
from tests.estimator.stream import Stream, calibration


@pytest.fixture(scope="module")
def once() -> Stream:
    """Booted, calibrated within 30 s, then worn."""
    return calibration(seed=1, after=worn(1))  # type: ignore[arg-type]
