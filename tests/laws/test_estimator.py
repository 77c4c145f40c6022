"""Laws of the mathematics."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from estimator.geometry import rotation
from estimator.stillness.detector import Stillness, Window
from estimator.tracking.bias_filter import BiasFilter
from estimator.tracking.bias_state import OWN, BiasKnobs, start
from estimator.tracking.evidence import GATES, Evidence

Floats = NDArray[np.float64]
RATES = arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.floats(-20, 20))
VECTORS = arrays(np.float64, 3, elements=st.floats(-1e-2, 1e-2))


def begun() -> BiasFilter:
    return BiasFilter(start(np.zeros(3), 1e-4 * np.eye(3), 0.0, BiasKnobs(), temperature_c=25.0))


def seen(z: Floats, var: float) -> Evidence:
    return Evidence("zaru", z, np.eye(3, OWN), var * np.eye(3), GATES[3])


@given(RATES)
def test_attitudes_stay_rotations_and_can_be_undone(rate: Floats) -> None:
    dt = np.full(len(rate), 0.01)
    path = rotation.attitudes(rate, dt)
    np.testing.assert_allclose(path @ path.transpose(0, 2, 1), np.broadcast_to(np.eye(3), path.shape), atol=1e-12)
    back = rotation.attitudes(-rate[::-1], dt)
    np.testing.assert_allclose(path[-1] @ back[-1], np.eye(3), atol=1e-12)


@given(RATES, st.integers(0, 30))
def test_attitudes_chain(rate: Floats, cut: int) -> None:
    dt = np.full(len(rate), 0.01)
    first, second = rotation.attitudes(rate[:cut], dt[:cut]), rotation.attitudes(rate[cut:], dt[cut:])
    np.testing.assert_allclose(first[-1] @ second[-1], rotation.attitudes(rate, dt)[-1], atol=1e-12)


@given(st.lists(st.tuples(VECTORS, st.floats(-40, 85)), min_size=1, max_size=30), st.floats(1e-12, 1e-2))
def test_evidence_never_makes_the_filter_less_sure_nor_its_covariance_crooked(
    lived: list[tuple[Floats, float]], var: float
) -> None:
    bias = begun()
    for i, (z, celsius) in enumerate(lived):
        before = bias.state.P
        receipt = bias.update(seen(z, var))
        assert (np.linalg.eigvalsh(before - bias.state.P) > -1e-15).all()
        np.testing.assert_allclose(bias.state.P, bias.state.P.T, atol=1e-18)
        assert (np.linalg.eigvalsh(bias.state.P) > 0).all()
        assert np.isfinite(bias.state.x).all()
        assert receipt.accepted is (receipt.test_ratio <= 1)
        bias.predict(float(i + 1), celsius)
        assert (np.diag(bias.state.P) > 0).all()


@given(arrays(np.float64, 3, elements=st.floats(allow_nan=True, allow_infinity=True)), st.floats())
@example(np.zeros(3), 1.3407807929942597e154)  # a determinant beyond all numbers
def test_nothing_from_outside_makes_the_filter_not_finite(z: Floats, var: float) -> None:
    bias = begun()
    with np.errstate(all="ignore"):
        bias.update(seen(z, var))
    assert np.isfinite(bias.state.x).all()
    assert np.isfinite(bias.state.P).all()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(1, 799), max_size=40, unique=True), st.integers(0, 100))
def test_windows_do_not_depend_on_batching(edges: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    gyro = 1e-3 * rng.normal(size=(800, 3))
    gyro[300:500] += np.sin(np.arange(200) / 20)[:, None]
    time = np.cumsum(rng.choice([0.01, 0.01, 0.01, 0.02, 0.4], 800, p=[0.33, 0.33, 0.33, 0.005, 0.005]))

    def run(bounds: list[int]) -> list[Window]:
        stillness = Stillness()
        parts = zip([0, *bounds], [*bounds, 800], strict=True)
        return [w for a, b in parts for w in stillness.feed(time[a:b], gyro[a:b], None)]

    for one, other in zip(run([]), run(sorted(edges)), strict=True):
        assert (one.start, one.end, one.still, one.start_time, one.end_time) == (
            other.start, other.end, other.still, other.start_time, other.end_time,
        )  # fmt: skip
        np.testing.assert_array_equal(one.summed, other.summed)
