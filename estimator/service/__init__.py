"""Estimator service: one thread owns all devices, and a fault in one device affects that device only.

Every sample that comes in goes out, or is counted with a reason (`conservation`). Begin at `run_loop`, then `intake`.
`cluster` shares a ward among several estimators: takeover of a dead one's devices, with `membership` and `replay_log`.
"""
