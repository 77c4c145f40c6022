"""Simulated devices and wearers with known truth. Shares no code with the estimator.

Begin at `day` (hours on a wearer as arrays) or `virtual_device` (a device that speaks the native protocol).
"""
