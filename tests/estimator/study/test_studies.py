"""What the studies compute, against other ways to it."""

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from bridge.sim.motion import Motion, Spin
from estimator.study import analysis, device, errors, orientation, real, sensors, simulation, testset, trials, typical
from estimator.study.registry import STUDIES
from estimator.study.sessions import turn_s
from estimator.study.spread import holds, spread
from estimator.study.study import generator


def test_a_spread_is_that_of_the_normal_distribution() -> None:
    rng = np.random.default_rng(1)
    found = spread(rng.normal(3.0, 2.0, 100_000))
    np.testing.assert_allclose(found.quantiles, 3 + 2 * np.array([-1.96, -0.674, 0.674, 1.96]), atol=0.05)
    assert holds(found.median_ci, found.median)
    means = [spread(rng.normal(size=50)) for _ in range(2000)]
    assert np.mean([holds(one.mean_ci, 0.0) for one in means]) == pytest.approx(0.945, abs=0.015)
    assert np.mean([holds(one.median_ci, 0.0) for one in means]) == pytest.approx(0.955, abs=0.025)


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


def test_jobs_cover_every_run_once() -> None:
    of = simulation.inputs(structs.replace(errors.STUDY.read(), runs=1003))
    for noise in of.noise_dps:
        assert sum(int(job[3]) - int(job[2]) for job in simulation.jobs(of) if job[0] == noise) == 1003


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


def test_a_machines_turn_is_once_around() -> None:
    for rate_dps in (25.42, -30.0):
        of = Spin(turn_s(rate_dps), np.array([0.0, 0.0, 1.0]), np.radians(rate_dps))
        time_s = np.arange(1, 2001) * of.duration_s / 2000
        rate = Motion([of]).advance(time_s).rate
        angle = orientation.angle_deg(rate, np.diff(time_s, prepend=0.0), 2)
        assert angle[-1] == pytest.approx(np.copysign(360.0, rate_dps), abs=1e-6)


def test_an_angle_is_about_an_axis_of_the_initial_frame() -> None:
    """Turned about z first, what the sensor reads about x adds up about another axis."""
    dt, rate = np.full(200, 0.01), np.zeros((200, 3))
    rate[:100, 2] = rate[100:, 0] = np.radians(90.0)
    np.testing.assert_allclose([orientation.angle_deg(rate, dt, axis)[-1] for axis in range(3)], [0, 90, 90], atol=1e-9)


def test_a_value_changes_what_it_is_of_and_nothing_else() -> None:
    scenario = analysis.STUDY.read()
    base = analysis.plan_of(scenario, ("noise", scenario.base.noise_dps, "mean"))
    fast = analysis.plan_of(scenario, ("sampling rate, wobble 3°", 400.0, "point"))
    assert (fast.rate_hz, fast.noise_dps, fast.wobble_deg, fast.sampling) == (400, 2 * base.noise_dps, 3, "point")
    long = analysis.plan_of(scenario, ("session length", 54.0, "mean"))
    assert 4 * long.rest_s + 3 * np.mean(long.turn_s) == pytest.approx(54.0)
    assert long.rest_s == pytest.approx(2 * base.rest_s)


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


def test_every_scenario_that_comes_with_truerate_can_be_read() -> None:
    for study in STUDIES.values():
        assert study.read().runs >= study.read().quick_runs


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
