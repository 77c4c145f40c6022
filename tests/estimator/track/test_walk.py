import numpy as np
import pytest

from estimator.track.walk import Walks


@pytest.mark.parametrize("m", [1, 2, 3])
def test_what_waits_to_be_taken_is_followed_as_by_a_state_that_has_the_walk_in_it(m: int) -> None:
    """Against a filter of n + 3 states, the last of which are the walk."""
    rng, n = np.random.default_rng(m), 9
    walk, walked = Walks.none(n), rng.uniform(1.0, 2.0, 3)
    walk.begin(np.full(3, 2.0), [])
    root = rng.normal(size=(n, n))
    joint = np.zeros((n + 3, n + 3))
    joint[:n, :n] = root @ root.T + 4.0 * np.eye(n)
    joint[:n, n:], joint[n:, :n], joint[n:, n:] = walk.cross[0], walk.cross[0].T, np.diag(walk.own[0, :3])
    F, Q = np.eye(n + 3), np.zeros((n + 3, n + 3))
    F[:3, 3:6] = 0.5 * np.eye(3)
    for i, var in enumerate(walked):
        Q[np.ix_([i, n + i], [i, n + i])] = var
    joint = F @ joint @ F.T + Q
    walk.step(F[:n, :n], walked)
    np.testing.assert_allclose(walk.cross[0], joint[:n, n:])
    np.testing.assert_allclose(np.diag(walk.own[0, :3]), joint[n:, n:])
    H = np.zeros((m, n + 3))
    H[:, :n] = rng.normal(size=(m, n))
    K = np.vstack([joint[:n] @ H.T @ np.linalg.inv(H @ joint @ H.T + np.eye(m)), np.zeros((3, m))])
    joint = (np.eye(n + 3) - K @ H) @ joint @ (np.eye(n + 3) - K @ H).T + K @ K.T
    walk.taken(K[:n], H[:, :n])
    np.testing.assert_allclose(walk.cross[0], joint[:n, n:])
    # A reading of then is one of now, less the walk and what warmth has done.
    along = H[:, :3]
    now, noise, M = walk.sight(np.hstack([along, np.zeros((m, n - 3))]))
    np.testing.assert_allclose(now, np.hstack([along, -0.5 * along, np.zeros((m, n - 6))]))
    np.testing.assert_allclose(noise, along @ joint[n:, n:] @ along.T)
    np.testing.assert_allclose(M, -joint[:n, n:] @ along.T)
