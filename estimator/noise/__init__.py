"""Gyroscope noise: Allan deviation with intervals, its three noise coefficients, and noise models of device kinds.

Begin at `allan_fit`; `device_model` reads configs/devices.
"""
