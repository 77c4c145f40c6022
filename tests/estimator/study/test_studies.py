"""What the studies compute, against other ways to it."""

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from estimator.study import device, real, sensors, simulation, testset, trials, typical
from estimator.study.study import generator


def test_the_mean_error_of_the_test_set_is_that_of_drawn_samples() -> None:
    """Equation 12, sample by sample."""
    scenario = structs.replace(testset.STUDY.read(), test_samples=400)
    off = np.array([[[0.01, -0.02, 0.005, 0.1, -0.2, 0.3]] * 500] * 2)
    raw, corrected = testset.mean_errors(scenario, 0.5, 3, off, np.random.default_rng(1))
    gyro, rng = simulation.gyro_of(scenario.seed, 3), np.random.default_rng(2)
    g = np.full(3, scenario.test_rate_dps / 3**0.5)
    drawn = []
    for _ in range(500):
        m = g / gyro.k + np.degrees(gyro.bias) + 0.5 * rng.normal(size=(400, 3))
        after = (gyro.k + off[0, 0, :3]) * (m - np.degrees(gyro.bias) - off[0, 0, 3:])
        drawn.append([np.mean(g - m, axis=0), np.mean(g - after, axis=0)])
    for found, wanted in zip((raw, corrected[0]), np.swapaxes(drawn, 0, 1), strict=True):
        np.testing.assert_allclose(found.mean(axis=0), wanted.mean(axis=0), atol=0.01)
        np.testing.assert_allclose(found.std(axis=0), wanted.std(axis=0), rtol=0.15)


def test_the_devices_are_the_papers() -> None:
    lsm, icm = (device.load_device(name) for name in sensors.STUDY.read().sensors)
    np.testing.assert_allclose(lsm.k, [1.2619, 1.1966, 1.1536])
    np.testing.assert_allclose(icm.b_dps, [-0.5169, -1.4402, 1.0502])
    assert (lsm.rate_hz, lsm.range_dps, icm.rate_hz, icm.range_dps) == (104, 245, 104, 250)
    # The errors that the paper puts in parentheses.
    for of, k in ((lsm, [0.0245, 0.0202, 0.0032]), (icm, [0.0037, 0.0087, 0.0078])):
        np.testing.assert_allclose(np.abs(np.array(of.paper["turn360"].k) - of.k), k, atol=1e-9)


def test_a_recorded_device_reads_what_it_is() -> None:
    scenario = sensors.STUDY.read()
    of = trials.inputs(structs.replace(scenario, runs=1))
    lsm = of.devices["lsm9ds1"]
    rng = generator(1, "x")
    recorded = device.record(lsm, of.servomotor.pieces(rng), rng)
    rest = recorded.recording.time_s < of.servomotor.rest_s
    np.testing.assert_allclose(np.degrees(recorded.recording.gyro[rest].mean(axis=0)), -lsm.b_dps, atol=0.15)
    rates = lsm.k * (recorded.recording.gyro + np.radians(lsm.b_dps))
    assert np.degrees(np.std(rates - recorded.rate)) < 0.2


@pytest.mark.parametrize("method", trials.METHODS)
def test_the_sessions_last_as_long_as_the_papers(method: str) -> None:
    of = trials.inputs(sensors.STUDY.read())
    pieces, *_ = trials.session_of(of, method, np.random.default_rng(1))
    lasts = sum(piece.duration_s for piece in pieces)
    for of_paper in of.devices.values():
        if method in of_paper.paper:
            assert lasts == pytest.approx(of_paper.paper[method].time_s, rel=0.1)


def test_the_stages_that_are_found_are_those_simulated() -> None:
    scenario = typical.STUDY.read()
    found = typical.results(scenario, {("session",): typical.work(scenario, ("session",))})
    assert [stage.axis for stage in found.found] == ["x", "y", "z"]
    for seen, true in zip(found.found, found.simulated, strict=True):
        assert seen.begin_s <= true.begin_s
        assert true.begin_s - seen.begin_s < 0.5
        assert 0 <= seen.end_s - true.end_s < 0.5
    for one in found.parameters:
        assert abs(one.found - one.truth) < 5 * one.std


@pytest.mark.data
def test_a_real_session_agrees_with_imucal(shared_data: Path) -> None:
    """Algorithm 1 and closure to 5e-4, transitions within its own standard deviations; too few poses are said."""
    scenario = structs.replace(real.STUDY.read(), recording=str(shared_data / "imucal" / "ferraris_session.npz"))
    found = real.results(scenario, {("session",): real.work(scenario, ("session",))})
    by = {row.method: row for row in found.rows}
    theirs = np.array(by["imucal"].k)
    for method in ("turn360", "closure"):
        row = by[method]
        assert row.k is not None
        assert row.closure_deg is not None
        np.testing.assert_allclose(row.k, theirs, atol=5e-4)
        assert max(row.closure_deg) < 0.1
    assert np.all(np.abs(np.array(by["transitions"].k) - theirs) < 3 * np.array(by["transitions"].k_std))
    assert by["accel_aided"].k is None
    assert "different poses" in by["accel_aided"].reason
