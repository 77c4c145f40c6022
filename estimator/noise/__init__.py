"""Noise of a gyroscope: Allan deviation with intervals, its three coefficients, and models of kinds of devices.

Begin at `allan_fit`; `device_model` reads configs/devices.
"""
