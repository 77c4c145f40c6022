"""Orientation from corrected rates and gravity, with its uncertainty: quaternions sensor to earth, tilt, heading.

A pure core: samples and what is known of the gyro come in, attitudes go out. Begin at `attitude`.
"""
