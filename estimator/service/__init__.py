"""Estimator service: one thread processes all devices, and a fault in one device affects that device only.

Start reading at `run_loop`. The loop works in rounds: one round is one pass from reading new messages to publishing.
Every sample received is published, or is counted with a reason; `periodic_checks` checks this.

A sample passes through these modules, after the bus has put it in order: `entrance` (is its device admitted and owned
by this estimator?), `quota`, `intake`, `decode` and `device`. `cluster` shares a ward's devices among several
estimators: `membership` decides which estimator owns a device, `takeover` moves devices.
"""
