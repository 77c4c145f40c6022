"""Gyro calibration: from the rests and turns of a session to a matrix, a bias, their covariance, a verdict and its reason.

Begin at `session` → `stages` → `turn_recognition` → `methods` → `result`. `closure` is the default method, `turn360`
the paper's Algorithm 1, `transitions` the full matrix from gravity.
"""
