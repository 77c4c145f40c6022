"""Simulated samples as an x-IMU3 sends them."""

import numpy as np

from bridge.framing import ximu3_encode
from bridge.sim.source import Samples


def ximu3_bytes(samples: Samples, begin_us: int = 0) -> bytes:
    """Binary messages: the temperature of the first sample, then each sample, clocks counting from begin_us."""
    time_us = begin_us + np.round(samples.clock_s * 1e6).astype(np.int64)
    warmth = ximu3_encode.temperature(int(time_us[0]), float(samples.temperature_c[0]))
    return warmth + b"".join(ximu3_encode.inertial(time_us, samples.gyro, samples.accel))
