"""Gyro calibration from the rests and turns of a session: matrix, bias, their covariance, and a verdict with its reason.

Reading order: `session` → `stages` → `turn_recognition` → `methods` → `result`.
`closure` is the default method. `turn360` is Algorithm 1 of Wang et al. 2024. `transitions` estimates the full 3x3
matrix from gravity.
"""
