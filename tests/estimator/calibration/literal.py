"""Algorithm 1 once more, from the paper's words alone: plain loops, own Rodrigues formula, own solver. Slow on purpose."""

import math

import numpy as np

from estimator.calibration.capture import Capture, Floats

Matrix = list[list[float]]


def product(a: Matrix, b: Matrix) -> Matrix:
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def rodrigues(v: list[float]) -> Matrix:
    angle = math.sqrt(sum(c * c for c in v))
    if angle == 0:
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    x, y, z = (c / angle for c in v)
    cross = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    square = product(cross, cross)
    s, c = math.sin(angle), 1 - math.cos(angle)
    return [[(i == j) + s * cross[i][j] + c * square[i][j] for j in range(3)] for i in range(3)]


def algorithm1(capture: Capture) -> Floats:
    """K (3,) of a capture."""
    b = [-float(v) for v in capture.rest.bias]
    K = [1.0, 1.0, 1.0]
    for _ in range(50):
        sums = []
        for turn in capture.turns:
            time = turn.samples.time.tolist()
            steps = sorted(time[i] - time[i - 1] for i in range(1, len(time)))
            half = len(steps) // 2
            first = steps[half] if len(steps) % 2 else (steps[half - 1] + steps[half]) / 2
            C: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
            S = [[0.0] * 3 for _ in range(3)]
            for t, m in enumerate(turn.samples.gyro.tolist()):
                dt = time[t] - time[t - 1] if t else first
                g = [K[j] * (m[j] + b[j]) for j in range(3)]
                C = product(C, rodrigues([c * dt for c in g]))
                for i in range(3):
                    for j in range(3):
                        S[i][j] += C[i][j] * g[j] * dt
            sums.append(np.array(S))
        # Newton on |S dK| = 360 degrees, with the slope by differences.
        dK = np.ones(3)
        for _ in range(30):
            off = np.array([np.linalg.norm(S @ dK) - 2 * math.pi for S in sums])
            slope = np.empty((3, 3))
            for j in range(3):
                moved = dK.copy()
                moved[j] += 1e-6
                slope[:, j] = (np.array([np.linalg.norm(S @ moved) - 2 * math.pi for S in sums]) - off) / 1e-6
            dK = dK - np.linalg.solve(slope, off)
        K = [K[j] * float(dK[j]) for j in range(3)]
        if math.sqrt(sum((float(d) - 1) ** 2 for d in dK)) <= 1e-5:
            break
    return np.array(K)
