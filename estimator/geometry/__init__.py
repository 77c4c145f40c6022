"""Gyro model `corrected = matrix (reading - bias)`, rotations on SO(3), and strapdown integration over a span."""
