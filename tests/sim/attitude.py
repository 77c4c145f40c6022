"""Attitudes from body rates, by the simulator's quaternions."""

import numpy as np

from bridge.sim.quaternion import Array, from_rotvec, multiply


def integrate(rate: Array, dt: Array, start: Array) -> Array:
    """Attitudes (n, 4) after each interval dt (n,) s of constant body rate (n, 3) rad/s, from start (4,)."""
    steps = from_rotvec(rate * dt[:, None])
    attitude = np.empty_like(steps)
    q = start[None]
    for i in range(len(steps)):
        q = multiply(q, steps[i : i + 1])
        q /= np.linalg.norm(q)
        attitude[i] = q[0]
    return attitude
