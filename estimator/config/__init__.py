"""The estimator's part of the ward file, and what a kind of device means for calibration and tracking.

Begin at `schema.Ward`.
"""
