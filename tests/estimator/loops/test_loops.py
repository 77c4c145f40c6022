"""Each loop against the same in NumPy's words."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.gyro import COARSE_STEP, least_step, mean_var, rounding_var, spread
from estimator.loops import second as loop
from estimator.loops import span as loops
from estimator.loops.gravity import carried, noted
from estimator.loops.late import knew_more, sight, went_on
from estimator.loops.rest import calm, nothing_held, tilted, together, upright
from estimator.loops.rest import measured as measured_along
from estimator.loops.second import measured
from estimator.loops.span import summed
from estimator.loops.weigh import inverse, stacked, weighed
from estimator.rotation import cross_matrix
from estimator.track.since import NOW

Floats = NDArray[np.float64]
UP = np.array([0.0, 0.0, 9.8])


@pytest.mark.parametrize("coarse", [0.0, 0.25])
@pytest.mark.parametrize("aided", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_readings_of_a_second(seed: int, coarse: float, *, aided: bool) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 120))
    time = np.cumsum(rng.uniform(0.005, 0.015, n))
    gyro, accel = rng.normal(0.0, 0.1, (n, 3)), rng.normal(0.0, 3.0, (n, 3))
    gyro = np.round(gyro / coarse) * coarse if coarse else gyro
    gyro[:, 2] = 0.5
    known = np.full(3, np.inf)
    clipped = np.zeros(n, bool)
    clipped[n // 2] = coarse > 0
    samples = np.column_stack([time, gyro, accel if aided else np.full((n, 3), np.nan), clipped])
    dt, rows, clips = measured(samples, -0.01, 1.0, COARSE_STEP, known)
    assert clips is (coarse > 0)
    np.testing.assert_array_equal(dt, np.diff(time, prepend=-0.01))
    mean, std = spread(gyro)
    step = least_step(gyro)
    for row, expected in (
        (loop.MEAN, mean),
        (loop.STD, std),
        (loop.STEP, step),
        (loop.MEAN_VAR, mean_var(std, step, n)),
        (loop.COMMON_VAR, rounding_var(std, step)),
        (loop.JITTER, np.diff(gyro, axis=0).std(axis=0, ddof=1)),
        (loop.HELD, [0.0, 0.0, 1.0]),
        *([(loop.ACCEL_MEAN, accel.mean(axis=0)), (loop.ACCEL_STD, accel.std(axis=0, ddof=1))] if aided else []),
        (loop.SCALARS, [0.0, dt.max(), np.linalg.norm(accel, axis=1).mean() if aided else np.nan]),
    ):
        np.testing.assert_allclose(rows[row], expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(known, rows[loop.STEP])


def test_the_least_step_is_remembered_where_noise_hides_it() -> None:
    known = np.array([0.1, 1e-6, 0.2])
    gyro = np.random.default_rng(0).normal(0.0, 5.0, (50, 3))
    samples = np.column_stack([np.arange(50) / 50, gyro, gyro, np.zeros(50)])
    _, rows, _ = measured(samples, -0.02, 0.01, COARSE_STEP, known)
    np.testing.assert_array_equal(rows[loop.STEP], [0.1, 1e-6, 0.2])


def steps_of(gyro: Floats, known: Floats) -> Floats:
    """(3,) of readings (n, 3) at rest, where these are known."""
    n = len(gyro)
    samples = np.column_stack([np.arange(n) / n, gyro, gyro, np.zeros(n)])
    return np.asarray(measured(samples, -1 / n, np.inf, COARSE_STEP, known)[1][loop.STEP])


@pytest.mark.parametrize("far", [3.0, 600.0])
def test_readings_on_a_known_grid_have_steps_of_it_and_finer_ones_are_found(far: float) -> None:
    rng, grid = np.random.default_rng(0), 1e-3
    gyro = grid * rng.integers(0, 20, (100, 3)) + grid * rng.uniform(-0.01, 0.01, (100, 3))  # as float32 rounds
    gyro[:, 1] = 3 * grid * np.round(gyro[:, 1] / (3 * grid))  # every third of its steps, and as far as that goes
    gyro[-1, 1] = 3 * grid * far
    gyro[:, 2] = grid
    known = np.full(3, grid)
    np.testing.assert_allclose(steps_of(gyro, known), [grid, 3 * grid, COARSE_STEP], rtol=1e-9)
    np.testing.assert_array_equal(known, grid)
    gyro[50, 0] += grid / 2
    assert steps_of(gyro, known)[0] < 0.51 * grid
    assert known[0] < 0.51 * grid


@pytest.mark.parametrize("m", [1, 2, 3, 5, 8])
def test_an_inverse_is_one(m: int) -> None:
    root = np.random.default_rng(m).normal(size=(m, m))
    S = root @ root.T + np.eye(m)
    np.testing.assert_allclose(inverse(S) @ S, np.eye(m), atol=1e-12)


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("late", [True, False])
def test_a_measurement_is_weighed(m: int, *, late: bool) -> None:
    rng = np.random.default_rng(m)
    n = 24
    root, walk = rng.normal(size=(n, n)), rng.normal(size=(3, 3))
    P, var = root @ root.T, walk @ walk.T
    cross = root[:, :3] @ walk.T / 10
    H = np.zeros((m, n))
    H[:, :6] = rng.normal(size=(m, 6))
    R = np.diag(rng.uniform(1.0, 2.0, m))
    x, z = rng.normal(size=n), rng.normal(size=m)
    late_rows = np.vstack([cross, var, [[0.5, 0.0, 0.0]], np.zeros((1, 3))])
    rows, nis, first = weighed(z, H, R, x, P, late_rows if late else NOW, 0)
    assert first == 0.0
    innovation, S = rows[:, 0], rows[:, 1:]
    # The error of x and the walk w, of which a late measurement sees H (x - w), as one state.
    both, seen, now = P, H, H.copy()
    if late:
        both = np.block([[P, cross], [cross.T, var]])
        now[:, 3:6] -= 0.5 * H[:, :3]
        seen = np.hstack([now, -H[:, :3]])
    expected = seen @ both @ seen.T + R
    np.testing.assert_allclose(innovation, z - now @ x, rtol=1e-12)
    np.testing.assert_allclose(S, expected, rtol=1e-10)
    assert nis == pytest.approx(innovation @ np.linalg.solve(expected, innovation))


@pytest.mark.parametrize(("first", "m"), [(1, 3), (3, 5), (2, 3)])
def test_a_measurement_is_weighed_as_it_will_be_after_another(first: int, m: int) -> None:
    rng, n = np.random.default_rng(first), 9
    root, roots = rng.normal(size=(n, n)), [rng.normal(size=(k, k)) for k in (first, m - first)]
    x, P, H, z = rng.normal(size=n), root @ root.T, rng.normal(size=(m, n)), rng.normal(size=m)
    R, then_R = (of @ of.T + np.eye(len(of)) for of in roots)
    together = stacked(z[:first], H[:first], R, z[first:], H[first:], then_R)
    np.testing.assert_array_equal(together[:, :n], H)
    np.testing.assert_array_equal(together[:, -1], z)
    rows, nis, before = weighed(together[:, -1], together[:, :n], together[:, n:-1], x, P, NOW, first)
    own = z[:first] - H[:first] @ x
    S = H[:first] @ P @ H[:first].T + R
    np.testing.assert_allclose(rows[:first, 0], own)
    np.testing.assert_allclose(rows[:first, 1 : 1 + first], S)
    assert before == pytest.approx(own @ np.linalg.solve(S, own))
    gain = P @ H[:first].T @ np.linalg.inv(S)
    x, P = x + gain @ own, P - gain @ H[:first] @ P
    left, S = z[first:] - H[first:] @ x, H[first:] @ P @ H[first:].T + then_R
    np.testing.assert_allclose(rows[first:, 0], left)
    np.testing.assert_allclose(rows[first:, 1 + first :], S, rtol=1e-9)
    assert nis == pytest.approx(left @ np.linalg.solve(S, left))


def test_a_second_is_noted_with_how_it_came_about() -> None:
    rng, n, m = np.random.default_rng(0), 9, 6
    x, P, rows, known = rng.normal(size=n), rng.normal(size=(n, n)), rng.normal(size=(2 * n + 1, n)), rng.normal(size=m)
    kept = noted(x, P, rows, known)
    parts = [(x[:m] - known)[None], P[:m, :m], rows[1 : 1 + m, :m], rows[1 + n : 1 + n + m, :m]]
    np.testing.assert_array_equal(kept, np.vstack(parts))


@pytest.mark.parametrize("what", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("place", [0, -1])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_has_no_nis(what: int, place: int, bad: float) -> None:
    given = [np.ones(2), np.eye(2, 6), np.eye(2), np.ones(6), np.eye(6)]
    given[what].flat[place] = bad
    for first in (0, 1):
        _, nis, before = weighed(*given, NOW, first)  # type: ignore[call-arg, arg-type]
        assert not np.isfinite(nis)
        assert not np.isfinite(before)


@pytest.mark.parametrize("var", [1e-200, 1e154, 1e300])
def test_what_has_no_inverse_has_no_nis(var: float) -> None:
    assert np.isnan(weighed(np.zeros(3), np.eye(3, 6), var * np.eye(3), np.zeros(6), np.zeros((6, 6)), NOW, 0)[1])


@pytest.mark.parametrize("m", [1, 2, 3])
def test_what_waits_to_be_taken_is_followed(m: int) -> None:
    rng, n = np.random.default_rng(m), 24
    cross, var = rng.normal(size=(n, 3)), np.diag(rng.uniform(1.0, 2.0, 3))
    own = rng.uniform(0.1, 0.2, 3)
    rows = np.vstack([cross, var, np.zeros((1, 3)), own])
    F = np.eye(n) + np.diag(rng.normal(size=n - 3), 3)
    walked = np.diag(rng.uniform(1.0, 2.0, 3))
    went_on(rows, F, np.pad(walked, (0, n - 3)))
    np.testing.assert_allclose(rows[:n], F @ cross + np.eye(n, 3) @ walked, rtol=1e-12)
    np.testing.assert_allclose(rows[n:-2], var + walked, rtol=1e-12)
    np.testing.assert_array_equal(rows[-2:], [[F[0, 3], 0.0, 0.0], own])
    H, K = np.zeros((m, n)), rng.normal(size=(n, m))
    H[:, :6] = rng.normal(size=(m, 6))
    for scale in (None, 0.5, 2.0):
        before, other = rows.copy(), rows.copy()
        other[n:-2] *= scale or 1.0
        other[-1] *= 3.0
        knew_more(rows, K, H, NOW if scale is None else other)
        shorter = (
            np.zeros((3, 3))
            if scale is None
            else min(scale, 1.0) * before[n:-2] + np.diag(own if scale > 1.0 else 3.0 * own)
        )
        expected = before[:n] - K @ (H @ before[:n] - H[:, :3] @ shorter)
        np.testing.assert_allclose(rows[:n], expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(rows[n:], before[n:])
    seen = sight(rows, H)
    now = H.copy()
    now[:, 3:6] -= rows[-2, 0] * H[:, :3]
    np.testing.assert_allclose(
        seen, np.hstack([now, -H[:, :3] @ rows[:n].T, H[:, :3] @ rows[n:-2] @ H[:, :3].T]), rtol=1e-9
    )


@pytest.mark.parametrize("n", [1, 2, 3, 8, 11])
def test_means_that_scatter_more_than_they_may_are_not_calm(n: int) -> None:
    rng, kept, motion_var = np.random.default_rng(n), 8, 0.1
    means = np.zeros((kept, 2, 3))
    for factor in (1.0, 3.0):
        given, var = factor * rng.normal(size=(n, 3)), rng.uniform(0.5, 1.5, (n, 3))
        told = [calm(means, i, given[i], var[i], motion_var, 1.5) for i in range(n)]
        latest, latest_var = given[-kept:], var[-kept:]
        spread = latest.var(axis=0, ddof=1) if n > 1 else np.zeros(3)
        assert told[-1] == (n < 3 or bool((spread < 1.5 * (latest_var.mean(axis=0) + motion_var)).all()))


def test_gravity_that_turns_is_seen_to_and_what_is_held_is_of_the_last_while() -> None:
    state, knobs = nothing_held(), (10.0, 4.0, 0.01**2, 5.0)
    still = np.full(3, 0.05)

    def tells(now: float, tilt: float) -> int:
        return tilted(state, now, 9.8 * np.array([np.sin(tilt), 0.0, np.cos(tilt)]), still, 100, knobs)

    error = np.sqrt(2 * (0.05**2 / 100 + 0.01**2)) / 9.8
    # Nobody knows yet; then that it has not, by 3.9 of 4 deviations
    assert [tells(float(i), 3.9 * error * (i > 0)) for i in range(7)] == [0, 0, 0, 0, 0, -1, -1]
    assert tells(7.0, 4.1 * error) == 1
    # What came before is let go.
    assert [tells(8.0 + i, 4.1 * error) for i in range(6)] == [0, 0, 0, 0, -1, -1]
    assert tells(14.0, 0.0) == 1
    # Slower than that within 10 s is not seen.
    slow = 3.9 * error / 11
    assert 1 not in [tells(15.0 + i, slow * i) for i in range(60)]
    assert 1 in [tells(80.0 + i, 1.2 * slow * i) for i in range(60)]


def test_of_more_means_than_there_is_room_for_the_latest_are_held() -> None:
    state = nothing_held()
    for i in range(100):
        assert tilted(state, 0.01 * i, UP, np.zeros(3), 10, (10.0, 4.0, 1e-4, 5.0)) == 0
    np.testing.assert_allclose(state[1:, 0], 0.01 * np.arange(100)[-(len(state) - 1) :])


@pytest.mark.parametrize("up", [[0.0, 0.0, 1.0], [0.0, -9.8, 0.0], [3.0, 0.0, 0.0], [1.0, -2.0, 0.5], [-5.0, 4.0, 8.0]])
def test_upright_axes_are_at_right_angles(up: list[float]) -> None:
    rows = upright(np.array(up))
    np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rows[2], np.array(up) / np.linalg.norm(up), rtol=1e-15)


def test_a_mean_is_measured_along_axes() -> None:
    rng, n = np.random.default_rng(0), 24
    along, mean, var, common = rng.normal(size=(3, 3)), rng.normal(size=3), rng.uniform(size=3), rng.uniform(size=3)
    rows = measured_along(along, mean, var, common, n)
    np.testing.assert_allclose(rows[:, :n], np.hstack([along, np.zeros((3, n - 3))]))
    np.testing.assert_allclose(rows[:, n : n + 3], along @ np.diag(var) @ along.T)
    np.testing.assert_allclose(rows[:, n + 3 :], np.column_stack([along @ mean, along**2 @ common]))


def test_measurements_together_count_by_what_they_are_worth() -> None:
    rng, common = np.random.default_rng(0), np.array([0.1, 0.3])
    z, R = rng.normal(size=(4, 2)), np.array([np.diag(rng.uniform(0.5, 2.0, 2)) + 0.1 for _ in range(4)])
    rows = together(z, R, common)
    worth = 1 / R.max(axis=(1, 2))
    worth /= worth.sum()
    np.testing.assert_allclose(rows[:, 2], worth @ z)
    np.testing.assert_allclose(rows[:, :2], np.einsum("k,kij", worth**2, R) + (1 - worth @ worth) * np.diag(common))


def test_the_state_goes_on_over_a_span_as_the_equations_say() -> None:
    rng = np.random.default_rng(4)
    n, matrix = 400, np.eye(3) + 0.05 * rng.normal(size=(3, 3))
    dt, gyro, accel = rng.uniform(0.001, 0.003, n), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) + UP
    g, v = rng.normal(size=3) + UP, rng.normal(size=3)
    length, kept, T = float(np.linalg.norm(g)), 0.9, float(dt.sum())

    def gone_on(error: Floats) -> Floats:
        """Gravity and velocity after it, of a state that is off by so much."""
        rows = summed(dt, gyro, accel, matrix, error[:3], error[12:15], error[15:])
        end, push = rows[loops.END], rows[loops.PUSH]
        return np.concatenate([end.T @ (g + error[6:9]), end.T @ (v + error[9:12] + push - (g + error[6:9]) * T)])

    span = summed(dt, gyro, accel, matrix, np.zeros(3), np.zeros(3), np.zeros(9))
    assert span[loops.SCALARS, 0] == pytest.approx(T)
    x = np.concatenate([np.zeros(6), g, v, np.zeros(12)])
    turned, pushed, posed = 1e-4, 2e-3, 3e-2
    rows = carried(x, np.zeros((24, 24)), span, kept, length, (turned, pushed, posed))
    moved, F, Q = rows[0], rows[1:25], rows[25:]
    np.testing.assert_allclose(moved[6:12], gone_on(np.zeros(24)), rtol=1e-9)
    step = 1e-5
    slopes = np.array([(gone_on(step * e) - gone_on(-step * e)) / (2 * step) for e in np.eye(24)]).T
    rest = np.delete(np.arange(24), [3, 4, 5])
    # What a sample turns moves all of its own push too: so much is left of steps of 2 ms.
    np.testing.assert_allclose(F[6:12][:, rest], slopes[:, rest], atol=0.02)
    expected = np.eye(24)
    expected[6:12] = F[6:12]
    expected[12:15, 12:15] *= kept
    np.testing.assert_array_equal(F, expected)
    by_turn = np.zeros((24, 3))
    by_turn[6:9] = span[loops.END].T @ cross_matrix(g)
    by_turn[9:12] = -T / 2 * by_turn[6:9]
    added = turned * by_turn @ by_turn.T + np.diag(np.repeat([0.0, 0.0, 0.0, pushed, posed, 0.0, 0.0, 0.0], 3))
    np.testing.assert_allclose(Q, added, atol=1e-15)


@pytest.mark.parametrize("std", [0.02, 0.15])
def test_what_no_first_order_tells_of_a_turn_by_a_doubtful_matrix_is_noise(std: float) -> None:
    """Against many matrices drawn: how far gravity is from where F takes it."""
    rng, n = np.random.default_rng(5), 100
    dt, accel, nothing = np.full(n, 0.01), np.tile(UP, (n, 1)), np.zeros(3)
    gyro = np.tile(np.radians([60.0, 0.0, 70.0]), (n, 1))
    P = np.zeros((24, 24))
    P[15:, 15:] = std**2 * np.eye(9)
    span = summed(dt, gyro, accel, np.eye(3), nothing, nothing, np.zeros(9))
    x = np.concatenate([np.zeros(6), UP, np.zeros(15)])
    rows, known = (carried(x, cov, span, 1.0, 9.8, (0.0, 0.0, 0.0)) for cov in (P, 0 * P))
    np.testing.assert_array_equal(rows[:25], known[:25])
    left = []
    for change in std * rng.normal(size=(500, 9)):
        end = summed(dt, gyro, accel, np.eye(3), nothing, nothing, change)[loops.END]
        left.append(end.T @ UP - rows[0, 6:9] - rows[7:10, 15:] @ change)
    told = np.trace(rows[31:34, 6:9])
    assert 0.2 * told < np.mean(np.square(left).sum(axis=1)) < 1.2 * told
    T = float(dt.sum())
    np.testing.assert_allclose(rows[34:37, 9:12], T**2 / 4 * rows[31:34, 6:9])
    np.testing.assert_allclose(rows[31:34, 9:12], -T / 2 * rows[31:34, 6:9])
