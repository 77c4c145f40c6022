"""Simulated devices and wearers with known truth. Shares no code with the estimator.

Begin at `motion` (attitude and rate curves), `imu_errors` (sensor errors) or `virtual_device` (a device that speaks the
native protocol).
"""
