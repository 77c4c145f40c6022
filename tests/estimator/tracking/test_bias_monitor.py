"""What receipts say against a bias, and which of them end it."""

import numpy as np
import pytest

from bridge.reasons.codes import Sentences
from estimator.tracking.bias_monitor import CONTRADICTIONS, BiasMonitor
from estimator.tracking.evidence import Receipt
from estimator.tracking.innovation_consistency import InnovationConsistency
from estimator.tracking.zaru import UNPROVEN

LEVEL, VERTICAL = "zaru level", "zaru vertical"


def receipt(kind: str, off_dps: float = 0.0, reason: str = "") -> Receipt:
    """Of a rest that agrees, or is this much off."""
    off, accepted = np.radians([off_dps]), not off_dps
    return Receipt(1.0, kind, off, 1e-8 * np.eye(1), 99.0 * (not accepted), accepted, reason, 1.0)


def said(doubt: BiasMonitor, *seconds: list[Receipt]) -> Sentences:
    for receipts in seconds:
        doubt.take(receipts, [])
    return doubt.news(1.0, gravity=False)


def settled(doubt: BiasMonitor, *receipts: Receipt) -> bool:
    doubt.take(receipts, [])
    doubt.consistency = InnovationConsistency()
    return doubt.settled(1.0, sure=True, gravity=False)


@pytest.fixture
def turning() -> BiasMonitor:
    """Doubted about the vertical."""
    doubt = BiasMonitor()
    off = receipt(VERTICAL, 0.25, "outside the gate")
    assert said(doubt, *[[receipt(LEVEL), off]] * CONTRADICTIONS)
    return doubt


def test_what_proves_nothing_ends_no_doubt(turning: BiasMonitor) -> None:
    assert not settled(turning, receipt(LEVEL, reason=UNPROVEN), receipt(VERTICAL, reason=UNPROVEN))
    assert settled(turning, receipt(LEVEL), receipt(VERTICAL))


def test_a_doubt_about_the_vertical_is_ended_by_what_tells_of_it(turning: BiasMonitor) -> None:
    """Which waits for seconds, while each of them says that it is level."""
    assert not settled(turning, *[receipt(LEVEL)] * 9)
    assert settled(turning, receipt(VERTICAL))


@pytest.mark.parametrize("kind", ["zaru", "bounded"])
def test_without_an_accelerometer_a_rest_tells_of_all(turning: BiasMonitor, kind: str) -> None:
    assert settled(turning, receipt(kind))
