"""Calibrates and tracks every gyro of a ward and republishes corrected rates."""
