"""Gyroscope noise: Allan deviation with intervals, its three noise coefficients, and noise models of device kinds.

The fit is in `allan_fit`. `device_model` reads configs/devices.
"""
