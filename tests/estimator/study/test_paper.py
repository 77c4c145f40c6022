import json
from pathlib import Path

import numpy as np
import pytest
from estimator.study.paper_runs import TEST_RATE, Scenario, compute, remaining_error
from rich.console import Console

from bridge.config import ConfigError
from bridge.sim.paper import PaperPlan, PaperSessions, draw_gyro, simulate
from estimator.batch import closure, turn360
from estimator.batch.capture import Capture, Rest, Samples, TurnCapture
from estimator.batch.closure import ClosureKnobs
from estimator.cli import build
from estimator.gyro import least_step
from estimator.study import many
from estimator.study.paper import run


@pytest.fixture(scope="module")
def sessions() -> PaperSessions:
    rng = np.random.default_rng(1)
    return simulate(draw_gyro(rng), PaperPlan(0.1, wobble_deg=3.0, replacement_deg=0.2), 4, rng)


def capture(of: PaperSessions, s: int) -> Capture:
    """One session as the product would see it, its stages known."""
    rests = [
        Rest(10.0 * i, 10.0 * i + 3, x.mean(axis=0), x.std(axis=0, ddof=1), least_step(x), len(x), None)
        for i, x in enumerate(of.rests[s])
    ]
    turns = []
    for i in range(3):
        n = int((of.dt[s, i] > 0).sum())
        time = 10.0 * i + 3 + np.arange(1, n + 1) / 104.0
        turns.append(TurnCapture(i, Samples(time, of.turns[s, i, :n], None, np.zeros(n, bool)), rests[i], rests[i + 1]))
    return Capture(rests[0], (turns[0], turns[1], turns[2]), tuple(rests))


def test_algorithm_1_on_many_is_algorithm_1_on_each(sessions: PaperSessions) -> None:
    together = many.algorithm1(sessions).theta
    for s, theta in enumerate(together):
        alone = turn360.estimate(capture(sessions, s))
        np.testing.assert_allclose(theta, [*alone.bias, *alone.k], atol=1e-10)


def test_closure_on_many_is_closure_on_each(sessions: PaperSessions) -> None:
    std = np.radians(0.2)
    together = many.closure(many.evidence(sessions, std))
    knobs = ClosureKnobs(replacement_std=std, rate_random_walk=0.0, misalignment_std=0.0, honest_p=0.0)
    for s in range(len(together.theta)):
        alone = closure.estimate(capture(sessions, s), knobs)
        np.testing.assert_allclose(together.theta[s], [*alone.bias, *alone.k], atol=1e-9)
        np.testing.assert_allclose(together.covariance[s], alone.covariance, rtol=1e-6, atol=1e-15)


def test_the_bound_is_the_information_at_the_truth() -> None:
    """By differences of a path integrated one step after the other."""
    rng = np.random.default_rng(2)
    gyro = draw_gyro(rng)
    of = simulate(gyro, PaperPlan(0.03, wobble_deg=3.0), 1, rng)
    truth, noise = np.concatenate([gyro.bias, gyro.k]), np.radians(0.03)
    clean = of.rates[0] / gyro.k + gyro.bias
    information = np.zeros((6, 6))
    information[:3, :3] = np.eye(3) * 4 * of.rests.shape[2] / noise**2
    for i in range(3):
        from scipy.spatial.transform import Rotation

        def end(theta: np.ndarray[tuple[int, ...], np.dtype[np.float64]], i: int = i) -> Rotation:
            steps = Rotation.from_rotvec(theta[3:] * (clean[i] - theta[:3]) * of.dt[0, i, :, None])
            attitude = Rotation.identity()
            for step in steps:
                attitude = attitude * step
            return attitude

        slope = np.stack(
            [(end(truth + h) * end(truth - h).inv()).as_rotvec() / 2e-6 for h in 1e-6 * np.eye(6)], axis=-1
        )
        spread, attitude = np.zeros((3, 3)), Rotation.identity()
        for rate, dt in zip(of.rates[0, i], of.dt[0, i], strict=True):
            attitude = attitude * Rotation.from_rotvec(rate * dt)
            part = attitude.as_matrix() * gyro.k * dt * noise
            spread += part @ part.T
        information += slope.T @ np.linalg.solve(spread, slope)
    bound = many.bound(of, noise, 0.0)[0]
    np.testing.assert_allclose(bound, np.diag(np.linalg.inv(information)), rtol=2e-3)


def test_workers_change_nothing() -> None:
    scenario = Scenario(90, (0.03,), seed=3)
    one, two = (compute(scenario, workers=n)[0.03] for n in (1, 2))
    np.testing.assert_array_equal(one.error, two.error)
    np.testing.assert_array_equal(one.nees, two.nees)
    assert one.error.shape == (2, 90, 6)


def test_the_command_leaves_table_and_picture(tmp_path: Path) -> None:
    given = build().parse_args(
        ["study", "paper", "--runs", "60", "--noise", "0.1", "--picture", str(tmp_path / "a" / "p.png")]
    )
    assert given.runs == 60
    console = Console(record=True, width=120)
    run(console, Scenario(60, (0.1,), 1.0, 0.1), 1, tmp_path / "a" / "p.png")
    assert (tmp_path / "a" / "p.png").stat().st_size > 10_000
    report = json.loads((tmp_path / "a" / "p.json").read_text())
    assert [row["method"] for row in report["rows"]] == ["algorithm1", "algorithm1", "closure", "closure"]
    assert report["scenario"]["wobble_deg"] == 1.0
    words = console.export_text()
    assert "NEES" in words
    assert "wobble 1°" in words


@pytest.mark.parametrize("theirs", ['{"rows": 3}', "[1]", "not json at all"])
def test_a_table_takes_the_place_of_none_but_a_table(theirs: str, tmp_path: Path) -> None:
    table, scenario = tmp_path / "results.json", Scenario(30, (0.1,))
    table.write_text(theirs)
    with pytest.raises(ConfigError, match=r"results\.json, which is there and is no such table"):
        run(Console(quiet=True), scenario, 1, tmp_path / "results.png")
    assert table.read_text() == theirs
    table.write_text('{"scenario": {}, "rows": []}')
    run(Console(quiet=True), scenario, 1, tmp_path / "results.png")
    assert len(json.loads(table.read_text())["rows"]) == 4
    assert {path.name for path in tmp_path.iterdir()} == {"results.png", "results.json"}


def test_what_is_left_on_a_test_set_is_nothing_for_the_truth_and_all_for_a_reading() -> None:
    truth = np.array([0.01, -0.02, 0.03, 0.9, 1.1, 1.05])
    assert remaining_error(truth, truth, 0.0) == pytest.approx(0.0, abs=1e-12)
    reading = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    rng = np.random.default_rng(1)
    rate = rng.uniform(-TEST_RATE, TEST_RATE, (200_000, 3))
    read = rate / truth[3:] + truth[:3]
    theta = truth + np.array([1e-3, 0, 0, 1e-3, -2e-3, 0])
    error = theta[3:] * (read - theta[:3]) - rate
    drawn = np.sqrt(np.mean(error**2) / np.mean((read - rate) ** 2))
    assert remaining_error(theta, truth, 0.0) == pytest.approx(drawn, rel=0.01)
    assert remaining_error(reading, truth, 0.0) == pytest.approx(1.0, rel=0.2)
