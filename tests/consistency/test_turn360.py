"""Calibrations over many sessions, recognised from the stream alone: accuracy, refusals, and nothing bad accepted."""

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.recording import Recording
from bridge.sim.calibration_session import simulate_session
from bridge.wire.messages import Verdict
from estimator.calibration.methods import BY_MOVEMENTS, METHODS
from estimator.offline import recordings
from estimator.study import protocols
from tests.sentences import codes

#: methods for three full turns; those by movements take other protocols too
BY_TURNS = [name for name in METHODS if name not in BY_MOVEMENTS]


def test_its_accuracy_is_the_papers_best() -> None:
    """0.03 °/s, 104 Hz, no wobble, one rest of 3 s, 200 sessions."""
    k, bias = [], []
    for seed in range(200):
        s = simulate_session(seed, rests_s=3.0, turn_s=(4.0, 6.0))
        result, _ = recordings.calibrate(Recording(s.time_s, s.gyro, None, None, s.rate_hz, ""), "turn360")
        assert result.verdict is Verdict.ACCEPTED, result.reason
        k.append(result.scale - s.truth.k)
        bias.append(np.degrees(result.bias - s.bias[0]))
    assert np.sqrt(np.mean(np.square(k))) <= 5e-5
    assert np.sqrt(np.mean(np.square(bias))) <= 2e-3


@pytest.mark.parametrize("method", BY_TURNS)
def test_good_sessions_of_all_kinds_are_accepted_and_right(method: str) -> None:
    """Any order, direction, goes, rate, bias, scale, with and without accelerometer: under 1 % refused."""
    refused: list[str] = []
    scores = []
    n = 110
    for seed in range(n):
        trial = protocols.good(seed)
        result, passed = recordings.calibrate(trial.recording, method)
        if result.verdict is not Verdict.ACCEPTED:
            refused.append(f"{seed}: {result.reason} {passed}")
            continue
        assert trial.k is not None
        scores.append((result.scale - trial.k) / np.sqrt(np.diag(result.covariance)[3:]))
    assert len(refused) < 0.01 * n, refused
    assert np.sqrt(np.mean(np.square(scores))) < 1.2
    assert np.abs(scores).max() < 5


#: the kinds of which none may be accepted, whatever comes out
NEVER = tuple(protocols.BAD)[:5]


@pytest.mark.parametrize("kind", protocols.BAD)
@pytest.mark.parametrize("method", BY_TURNS)
def test_no_bad_protocol_is_accepted_wrong(kind: str, method: str) -> None:
    for seed in range(40 if kind in NEVER else 16):
        trial = protocols.BAD[kind](seed)
        result, _ = recordings.calibrate(trial.recording, method, knobs=trial.knobs)
        assert not protocols.is_wrong(result, trial.k), (seed, result.reason, result.scale, trial.k)
        assert kind not in NEVER or result.verdict is not Verdict.ACCEPTED, (seed, result.reason)


@pytest.mark.parametrize("kind", protocols.UNDETECTABLE)
def test_what_nothing_shows_is_said(kind: str) -> None:
    for seed in range(8):
        result, _ = recordings.calibrate(protocols.UNDETECTABLE[kind](seed).recording)
        assert result.verdict is not Verdict.ACCEPTED or {Code.TURNS_ASSUMED, Code.VERTICAL_TURNS_ASSUMED} & set(
            codes(result.reason)
        )
