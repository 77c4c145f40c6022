"""From a driver's events to published batches: clock, order, gaps, boots, sensor faults.

Every sample is published once and in order, or counted with a reason. One thread a device, one pump a bridge.
Begin at `intake`, then `device_thread` and `pump`.
"""
