"""Ingest: converts a driver's events to published batches. It handles clocks, order, gaps, boots and sensor faults.

Every sample is published once and in order, or counted with a reason. Each device has a thread; each bridge has a
`Pump`, which publishes the batches of all devices. Begin at `intake`, then `device_thread` and `pump`.
"""
