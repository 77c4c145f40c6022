import numpy as np
import pytest

from bridge.sim.motion_scripts import TurnPlan
from bridge.wire.messages import Verdict
from estimator.calibration.capture import Capture
from estimator.calibration.methods import METHODS
from estimator.calibration.result import Result, nothing
from estimator.calibration.session import CalibrationSession
from estimator.calibration.session_events import Finished, RestFound, TurnFound
from estimator.stillness.detector import Stillness
from tests.estimator.calibration.sessions import fed, progress
from tests.estimator.stream import calibration
from tests.sentences import free

X, Y, Z = TurnPlan(0), TurnPlan(1), TurnPlan(2)


@pytest.mark.parametrize("order", [(X, Y, Z), (Z, Y, X), (Y, Z, X)])
def test_rests_turns_and_the_result_in_their_order(order: tuple[TurnPlan, ...]) -> None:
    found = progress(calibration(*order, seed=1))
    kinds = [type(p) for p in found]
    assert kinds == [RestFound, RestFound, TurnFound, RestFound, TurnFound, RestFound, TurnFound, Finished]
    assert [p.turn.axis for p in found if isinstance(p, TurnFound)] == [turn.axis for turn in order]
    assert isinstance(found[-1], Finished)
    assert found[-1].result.verdict is Verdict.ACCEPTED


@pytest.mark.parametrize("plan", [(X, Y), (X, X, Y), (Z, Z, Z, Z), (X,)])
def test_a_missing_axis_is_waited_for(plan: tuple[TurnPlan, ...]) -> None:
    assert not any(isinstance(p, Finished) for p in progress(calibration(*plan, seed=2)))


def test_the_last_turn_about_an_axis_counts() -> None:
    """The first turn about z misses by 20 degrees, which nothing shows; it is done again."""
    of = calibration(TurnPlan(2, 340.0), X, Z, Y, seed=3)
    last = progress(of)[-1]
    assert isinstance(last, Finished)
    np.testing.assert_allclose(last.result.scale, of.truth.k, atol=1e-3)


def test_only_the_turns_that_are_to_be_repeated_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    def open_about_y(capture: Capture) -> Result:
        return nothing("closure", Verdict.REPEAT, free("the turn about y did not end where it began"), (1,))

    monkeypatch.setitem(METHODS, "closure", open_about_y)
    of = calibration(X, Y, Z, seed=8)
    session = CalibrationSession()
    found = fed(session, Stillness().feed(of.time, of.gyro, of.accel))
    assert isinstance(found[-1], Finished)
    assert (session.done(), session.missing()) == ((0, 2), (1,))
