"""What receipts say against a bias, and which of them end it."""

import numpy as np
import pytest

from bridge.reasons.codes import Code, Sentences
from estimator.track.doubt import Doubt
from estimator.track.evidence import Receipt
from estimator.track.zaru import UNPROVEN
from tests.sentences import free

LEVEL, VERTICAL = "zaru level", "zaru vertical"


def receipt(kind: str, off_dps: float = 0.0, reason: str = "") -> Receipt:
    """Of a rest that agrees, or is this much off."""
    off, accepted = np.radians([off_dps]), not off_dps
    return Receipt(1.0, kind, off, 1e-8 * np.eye(1), 99.0 * (not accepted), accepted, reason, 1.0)


def said(doubt: Doubt, *seconds: list[Receipt]) -> Sentences:
    for receipts in seconds:
        doubt.take(receipts, [])
    return doubt.news(1.0, gravity=False)


def settled(doubt: Doubt, *receipts: Receipt) -> bool:
    doubt.take(receipts, [])
    doubt.consistency.forget()
    return doubt.settled(1.0, sure=True, gravity=False)


@pytest.fixture
def turning() -> Doubt:
    """Doubted about the vertical."""
    doubt = Doubt()
    off = receipt(VERTICAL, 0.25, "outside the gate")
    assert said(doubt, *[[receipt(LEVEL), off]] * doubt.knobs.contradictions)
    return doubt


def test_what_proves_nothing_ends_no_doubt(turning: Doubt) -> None:
    assert not settled(turning, receipt(LEVEL, reason=UNPROVEN), receipt(VERTICAL, reason=UNPROVEN))
    assert settled(turning, receipt(LEVEL), receipt(VERTICAL))


def test_a_doubt_about_the_vertical_is_ended_by_what_tells_of_it(turning: Doubt) -> None:
    """Which waits for seconds, while each of them says that it is level."""
    assert not settled(turning, *[receipt(LEVEL)] * 9)
    assert settled(turning, receipt(VERTICAL))


@pytest.mark.parametrize("kind", ["zaru", "bounded"])
def test_without_an_accelerometer_a_rest_tells_of_all(turning: Doubt, kind: str) -> None:
    assert settled(turning, receipt(kind))


def test_a_doubt_that_was_restored_is_ended_by_all_of_a_rest() -> None:
    """Nobody knows any more what had raised it."""
    doubt = Doubt()
    doubt.why = free("it was in doubt")
    assert not settled(doubt, receipt(LEVEL))
    assert not settled(doubt, receipt(VERTICAL, 0.25, "outside the gate"))
    assert settled(doubt, receipt(VERTICAL))


def test_rests_too_short_to_prove_anything_end_no_row_of_those_that_contradict() -> None:
    doubt, short = Doubt(), [receipt(LEVEL, reason=UNPROVEN), receipt(VERTICAL, reason=UNPROVEN)]
    long = [receipt(LEVEL), receipt(VERTICAL, 0.25, "outside the gate")]
    rests = [short, long] * doubt.knobs.contradictions
    assert not said(doubt, *rests[:-1])
    assert said(doubt, rests[-1]) == (Code.REST_CONTRADICTS_BIAS(rate_dps="0.25"),)


def test_what_is_said_to_be_off_is_what_was_refused() -> None:
    """It was what came last: "0.00 °/s off"."""
    doubt = Doubt()
    off = [receipt(LEVEL, 0.25, "outside the gate"), receipt(VERTICAL)]
    assert said(doubt, *[off] * doubt.knobs.contradictions) == (Code.REST_CONTRADICTS_BIAS(rate_dps="0.25"),)


def test_who_does_not_rest_is_not_said_to() -> None:
    off = receipt("bounded vertical", 0.25, "outside the gate")
    assert said(Doubt(), [off]) == (Code.QUIET_CONTRADICTS_BIAS(rate_dps="0.25"),)


@pytest.mark.parametrize(("nis", "doubted"), [(0.03, False), (3.0, True)])
def test_what_is_by_far_too_small_for_its_noise_raises_no_doubt_though_it_clings_together(
    nis: float, *, doubted: bool
) -> None:
    """Quiet seconds that may be no rest are granted so much that hardly more than the bias's own error is left of them."""
    doubt = Doubt()
    off = np.full(3, 0.01 * np.sqrt(nis / 3))
    alike = Receipt(1.0, "zaru", off, 1e-4 * np.eye(3), 0.01, accepted=True, reason=UNPROVEN, nis=nis)
    assert bool(said(doubt, *[[alike]] * 40)) is doubted
    assert (doubt.consistency.inflation > doubt.knobs.inflation) is doubted
