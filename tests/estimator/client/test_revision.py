"""Revised rates are what the readings give with the bias of the revision, sample by sample."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bridge.wire.messages import BiasRevision, CorrectedBatch, Quality
from estimator.client import covers, revised
from tests.estimator.device.test_correction import BIAS, CALIBRATION, chosen
from tests.estimator.stream import NAME, corrected_by, stream
from tests.sentences import free

START_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
MATRIX = np.array([[2.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 4.0]])


def batch(sequence: int = 100, n: int = 5, **changes: Any) -> CorrectedBatch:
    """Ten samples a second; sample 100 is at START_NS. Rates 1, bias 0.25 all over."""
    plain = CorrectedBatch(
        device="d", boot=7, sequence=sequence, start_time_ns=START_NS + (sequence - 100) * SECOND // 10,
        tick_period_s=1e-3, clock_rate=1.0, ticks=np.arange(sequence, sequence + n, dtype=np.uint64) * 100,
        rate=np.ones((n, 3), np.float32), flags=np.zeros(n, np.uint32), quality=Quality.DEGRADED,
        noise_std=np.ones(3, np.float32), bias_std=np.full(3, 0.5, np.float32), scale_std=np.ones(3, np.float32),
        bias=np.full(3, 0.25, np.float32), calibration="c1", cross_std=np.ones(3, np.float32),
    )  # fmt: skip
    return replace(plain, **changes)


def revision(**changes: Any) -> BiasRevision:
    """Samples 100, 104 and 124: the bias rises by 1 on x, then falls by 2 on z; the deviation is a sixteenth, then less."""
    plain = BiasRevision(
        device="d", boot=7, calibration="c1", time_ns=START_NS + 9 * SECOND, matrix=MATRIX,
        sequences=np.array([100, 104, 124], np.uint64),
        times_ns=np.array([START_NS, START_NS + 4 * SECOND // 10, START_NS + 24 * SECOND // 10], np.int64),
        bias=np.array([[0.25, 0, 0.25], [1.25, 0, 0.25], [1.25, 0, -1.75]], np.float32),
        bias_std=np.array([[3, 4, 0], [3, 4, 0], [1, 0, 0]], np.float32) / np.float32(16), reason=free("at rest again"),
    )  # fmt: skip
    return replace(plain, **changes)


def test_by_hand() -> None:
    now = revised(batch(), revision())
    # bias - bias now on x is 0, -1/4, -1/2, -3/4, -1, on y 1/4, on z 0; the matrix takes half of y to x and all of it from z.
    np.testing.assert_allclose(now.rate[:, 0], 1 + 2 * np.array([0, -0.25, -0.5, -0.75, -1]) + 0.125, rtol=1e-6)
    np.testing.assert_allclose(now.rate[:, 1], 1.25)
    np.testing.assert_allclose(now.rate[:, 2], 0.75)
    np.testing.assert_allclose(now.bias, [0.75, 0, 0.25])  # the mean of the five
    # sqrt(2² 3² + ½² 4²), 4, and 4 by way of y, in sixteenths
    np.testing.assert_allclose(now.bias_std, np.array([np.sqrt(40), 4, 4]) / 16, rtol=1e-6)
    assert (now.sequence, now.quality, len(now)) == (100, Quality.DEGRADED, 5)
    assert {now.rate.dtype, now.bias.dtype, now.bias_std.dtype} == {np.dtype(np.float32)}


def test_it_is_what_the_readings_give_with_the_revised_bias() -> None:
    (samples,) = stream([], 3.0).part(0, 40).batches([])
    then = chosen(CALIBRATION)
    after = replace(
        then, model=replace(then.model, bias=BIAS + np.array([0.02, -0.01, 0.005])), bias_std=np.full(3, 2e-5)
    )
    old, new = corrected_by(then, samples), corrected_by(after, samples)
    level = revision(
        device=NAME, boot=samples.boot, matrix=CALIBRATION.matrix, sequences=np.array([0, 39], np.uint64),
        times_ns=old.sample_time_ns[[0, 39]], bias=np.tile(new.bias, (2, 1)), bias_std=np.full((2, 3), 2e-5, np.float32),
    )  # fmt: skip
    now = revised(old, level)
    np.testing.assert_allclose(now.rate, new.rate, atol=1e-7)
    np.testing.assert_allclose(now.bias, new.bias, rtol=1e-6)
    np.testing.assert_allclose(now.bias_std, new.bias_std, rtol=1e-6)


@pytest.mark.parametrize(
    ("sequence", "covered"),
    [
        (95, [0, 0, 0, 0, 0]),
        (97, [0, 0, 0, 1, 1]),
        (100, [1, 1, 1, 1, 1]),
        (123, [1, 1, 0, 0, 0]),
        (125, [0, 0, 0, 0, 0]),
    ],
)
def test_only_samples_between_the_first_and_the_last_point(sequence: int, covered: list[int]) -> None:
    old, inside = batch(sequence), np.array(covered, bool)
    np.testing.assert_array_equal(covers(revision(), old), inside)
    now = revised(old, revision())
    np.testing.assert_array_equal(now.rate[~inside], old.rate[~inside])
    assert (now.rate[inside] != old.rate[inside]).any(axis=1).all()
    if inside.any() and not inside.all():
        # One deviation for all of the batch: the worst.
        assert (now.bias_std >= old.bias_std).all()
    if not inside.any():
        assert now is old


@pytest.mark.parametrize("change", [{"device": "e"}, {"boot": 8}, {"calibration": "c2"}, {"calibration": ""}], ids=str)
def test_another_device_boot_or_calibration_is_left_as_it_is(change: dict[str, Any]) -> None:
    other = batch(**change)
    assert revised(other, revision()) is other
