"""Estimator service: one thread owns all devices, and a fault in one device affects that device only.

Every sample that comes in goes out, or is counted with a reason (`periodic_checks`). Begin at `run_loop`. The loop
works in rounds: one round is one pass from reading new messages to publishing. A sample goes from there through
`entrance` (is its device admitted, and ours?), `quota`, `intake`, `decode` and `device`; the bus has put it in order.
`cluster` shares a ward among several estimators: `membership` says whose a device is, `takeover` moves devices.
"""
