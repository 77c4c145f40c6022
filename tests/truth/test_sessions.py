"""Sessions of another simulator that are easily judged wrongly: what each is told."""

from pathlib import Path

import numpy as np
import pytest

from bridge.reasons.codes import Code, Sentence
from bridge.recording import load
from bridge.wire.messages import Verdict
from estimator.calibration.result import Result
from estimator.offline import recordings
from tests.sentences import codes

pytestmark = pytest.mark.data


def calibrated(folder: Path, name: str) -> tuple[Result, list[str], np.ndarray]:
    """The result, why movements were passed over, and the true scale factors (3,)."""
    path = folder / "sessions" / f"{name}.npz"
    result, passed_over = recordings.calibrate(load(path))
    with np.load(path) as data:
        return result, passed_over, data["true_k"]


def test_pushes_that_were_cut_off_are_refused_though_no_range_is_told(shared_data: Path) -> None:
    result, passed_over, _ = calibrated(shared_data, "clipped_pushes_250dps")
    assert result.verdict is Verdict.REPEAT
    assert sum("too fast for the gyro's range" in words for words in passed_over) == 3


@pytest.mark.parametrize(
    ("name", "condition"),
    [
        ("turn_350_gyro_only", Code.TURNS_ASSUMED()),
        ("turn_355_vertical_with_accel", Code.VERTICAL_TURNS_ASSUMED(axes="z")),
    ],
)
def test_a_wrong_angle_that_nothing_shows_is_a_condition_of_the_result(
    shared_data: Path, name: str, condition: Sentence
) -> None:
    result, _, k = calibrated(shared_data, name)
    assert result.verdict is Verdict.ACCEPTED
    assert condition in result.reason
    assert np.all(np.abs(result.scale - k)[:2] < 4 * result.scale_std[:2]), "the other two turns were right"


def test_a_turn_that_was_dropped_is_named_with_the_reason(shared_data: Path) -> None:
    result, passed_over, _ = calibrated(shared_data, "warm_up_0")
    assert result.verdict is Verdict.REPEAT
    assert result.repeat == (0,)
    assert Code.TURN_BIAS_MOVED in codes(result.reason)
    assert any("no longer counts" in words for words in passed_over)
