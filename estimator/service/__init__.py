"""The estimator as a service. One thread owns all devices; a fault in one device stays there.

Every sample that comes in goes out, or is counted with a reason (`conservation`). Begin at `run_loop`, then `intake`; `cluster`
shares a ward among several estimators.
"""
