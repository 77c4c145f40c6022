from dataclasses import replace

import numpy as np
import pytest

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.wire.messages import Verdict
from estimator.calibration import turn360
from estimator.calibration.capture import Capture
from estimator.calibration.methods import METHODS, Method, by_closure, by_turn360
from estimator.calibration.result import PARAMETERS, Result, judge, unlikely
from tests.estimator.calibration.sessions import capture
from tests.estimator.stream import calibration
from tests.sentences import codes


@pytest.fixture(scope="module")
def good() -> tuple[Capture, turn360.Turn360]:
    found = capture(calibration(seed=20))
    return found, turn360.estimate(found)


def judged(good: tuple[Capture, turn360.Turn360], **change: object) -> Result:
    found = {"k": good[1].k, "bias": good[1].bias, "covariance": good[1].covariance} | change
    return judge("turn360", good[0], **found)  # type: ignore[arg-type]


def test_a_good_session_is_accepted_with_all_that_belongs_to_it(good: tuple[Capture, turn360.Turn360]) -> None:
    result = METHODS["turn360"](good[0])
    assert result.verdict is Verdict.ACCEPTED
    assert result.repeat == ()
    assert result.parameters == PARAMETERS
    assert result.covariance.shape == (6, 6)
    assert (np.linalg.eigvalsh(result.covariance) > 0).all()
    assert [turn.axis for turn in result.turns] == [0, 1, 2]
    np.testing.assert_allclose(np.abs([turn.angle for turn in result.turns]), 2 * np.pi, atol=1e-4)
    assert result.turns[1].angle < 0, "the second was turned the other way"
    assert all(4.0 < turn.duration_s < 5.5 for turn in result.turns)
    assert all(turn.closure_error < np.radians(0.1) for turn in result.turns)
    np.testing.assert_allclose(np.degrees(result.noise_std), 0.03, rtol=0.2)
    np.testing.assert_allclose(result.scale_std, np.sqrt(np.diag(result.covariance)[3:]) / result.scale)
    assert good[0].rest.start < result.bias_time < good[0].rest.end


@pytest.mark.parametrize(
    ("k", "word"), [(2.0, "factor of two"), (0.5, "factor of two"), (57.3, "degrees"), (1.6, "sensi")]
)
def test_an_unbelievable_scale_is_refused_with_a_likely_cause(
    good: tuple[Capture, turn360.Turn360], k: float, word: str
) -> None:
    result = judged(good, k=np.full(3, k))
    assert result.verdict is Verdict.REFUSED
    assert word in english(*result.reason)


def test_an_open_turn_is_repeated_and_named(good: tuple[Capture, turn360.Turn360]) -> None:
    open_turn = judged(good, k=good[1].k * [1.0, 1.05, 1.0])
    assert open_turn.verdict is Verdict.REPEAT
    assert open_turn.repeat == (1,)
    assert Code.TURNS_OPEN in codes(open_turn.reason)


@pytest.mark.parametrize("method", [by_turn360, by_closure])
def test_what_does_not_converge_is_refused_in_words(good: tuple[Capture, turn360.Turn360], method: Method) -> None:
    short = tuple(replace(t, samples=t.samples.between(t.samples.time[0], t.samples.time[40])) for t in good[0].turns)
    result = method(Capture(good[0].rest, short))
    assert result.verdict is Verdict.REFUSED
    assert result.repeat == (0, 1, 2)
    assert Code.NOT_CONVERGED in codes(result.reason)


@pytest.mark.parametrize(
    ("k", "limit", "axes"),
    [
        ((1.0, 1.01, 1.091), 0.072, (2,)),  # z turned by 330°
        ((1.091, 1.0, 0.818), 0.072, (0, 2)),
        ((1.17, 1.18, 0.96), 0.16, ()),  # what one axis is off by, the others or a library may be
        ((1.26, 1.20, 1.15), 0.16, ()),  # an LSM9DS1 of Wang et al. 2024
        ((2.0, 2.02, 1.98), 0.072, ()),
    ],
)
def test_a_scale_that_is_neither_the_makers_nor_the_others_is_unlikely(
    k: tuple[float, ...], limit: float, axes: tuple[int, ...]
) -> None:
    found = unlikely(np.array(k), limit)
    assert (() if found is None else found[0]) == axes
    assert unlikely(np.array(k), np.inf) is None
