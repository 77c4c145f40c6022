"""Orientation from corrected rates and gravity, with its uncertainty: quaternions sensor to earth, tilt, heading.

A pure core: samples and the gyro's parameters come in, attitudes go out. Begin at `attitude`.
"""
