from dataclasses import replace

import numpy as np
import pytest

from bridge.wire.messages import Calibration, Quality, Verdict
from estimator.calibration.result import PARAMETERS
from estimator.device.correction import Correction, believed, choose
from estimator.geometry.gyro_model import Floats, PriorKnobs
from tests.estimator.stream import corrected_by, stream

KNOBS = PriorKnobs()
CALIBRATION = Calibration(
    device="chest",
    boot=1,
    id="c1",
    time_ns=1,
    method="turn360",
    verdict=Verdict.ACCEPTED,
    reason=(),
    matrix=np.diag([0.9, 1.0, 1.1]),
    bias=np.array([0.01, 0.02, 0.03]),
    parameters=PARAMETERS,
    covariance=np.diag([1e-8, 1e-8, 1e-8, 1e-6, 4e-6, 9e-6]),
    turns=(),
    noise_std=np.full(3, 0.001),
    model="",
    firmware="",
    gyro_range=0.0,
    rate_hz=0.0,
    temperature_c=25.0,
    who="",
)
BIAS, FLICKER = np.array([0.011, 0.021, 0.031]), 3e-4


def chosen(
    calibration: Calibration | None,
    earlier: Calibration | None = None,
    bias: Floats | None = BIAS,
    noise_std: Floats | None = None,
    moves: float | None = None,
) -> Correction:
    """With a bias that was tracked to 1e-4 rad/s, or with what is believed of it before."""
    belief = believed(calibration, earlier, KNOBS, moves)
    if bias is None:
        return choose(belief, belief.model.bias, belief.bias_std, noise_std, FLICKER, sure=False)
    return choose(belief, bias, np.full(3, 1e-4), noise_std, FLICKER, sure=True)


def test_the_datasheet_when_nothing_is_known() -> None:
    best = chosen(None, bias=None)
    assert (best.quality, best.calibration) == (Quality.NONE, "")
    np.testing.assert_array_equal(best.model.matrix, np.eye(3))
    np.testing.assert_array_equal(best.bias_std, np.full(3, KNOBS.bias_std))


def test_a_rest_gives_the_bias_and_nothing_of_the_scale() -> None:
    best = chosen(None)
    assert best.quality is Quality.BIAS_ONLY
    np.testing.assert_array_equal(best.model.bias, BIAS)
    np.testing.assert_array_equal(best.model.scale_std, np.full(3, KNOBS.scale_std))


@pytest.mark.parametrize("moves", [None, 0.03])
def test_an_earlier_boot_gives_the_scale_as_far_as_it_holds_from_boot_to_boot(moves: float | None) -> None:
    best = chosen(None, CALIBRATION, bias=None, moves=moves)
    assert (best.quality, best.calibration) == (Quality.PRIOR, "c1")
    np.testing.assert_array_equal(best.model.matrix, CALIBRATION.matrix)
    np.testing.assert_array_equal(best.bias_std, np.full(3, KNOBS.bias_std))
    scale_std = moves or KNOBS.scale_std
    np.testing.assert_allclose(
        best.model.scale_std, np.hypot(scale_std, np.array([1e-3, 2e-3, 3e-3]) / [0.9, 1.0, 1.1])
    )
    with_rest = chosen(None, CALIBRATION)
    assert with_rest.quality is Quality.BIAS_ONLY
    np.testing.assert_array_equal(with_rest.model.matrix, CALIBRATION.matrix)


def test_this_boots_calibration_goes_before_an_earlier_one() -> None:
    best = chosen(CALIBRATION, replace(CALIBRATION, id="old", matrix=np.eye(3)), noise_std=np.full(3, 0.002))
    assert (best.quality, best.calibration) == (Quality.GOOD, "c1")
    np.testing.assert_array_equal(best.model.bias, BIAS)
    np.testing.assert_allclose(best.model.scale_std, np.array([1e-3, 2e-3, 3e-3]) / [0.9, 1.0, 1.1])
    np.testing.assert_array_equal(best.model.noise_std, np.full(3, 0.002))


def test_published_deviations_add_up() -> None:
    (batch,) = stream([], 0.1).batches([])
    corrected = replace(
        corrected_by(chosen(CALIBRATION), batch, 0, 2),
        rate=np.array([[1.0, -2.0, 0.0], [0.0, 0.0, 0.0]], np.float32),
    )
    noise_bias = np.array([0.9, 1.0, 1.1]) * np.sqrt(0.001**2 + 1e-4**2 + FLICKER**2)
    np.testing.assert_allclose(corrected.rate_std[1], noise_bias, rtol=1e-5)
    np.testing.assert_allclose(
        corrected.rate_std[0],
        np.sqrt(
            noise_bias**2
            + [
                scale**2 + across**2
                for scale, across in zip(
                    [1e-3 / 0.9, 4e-3, 0.0], 0.01 * np.array([2.0, 1.0, np.sqrt(5.0)]), strict=True
                )
            ]
        ),
        rtol=1e-5,
    )
