"""Orientation from corrected rates and gravity, with its uncertainty: quaternions sensor to earth, tilt, heading.

Pure functions of samples and gyro parameters; the filter is in `attitude`.
"""
