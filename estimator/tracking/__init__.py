"""Bias tracking in one boot, with an honest uncertainty: a Kalman filter, and one file for each kind of evidence.

Begin at `tracker`, then `tracked_bias`, `bias_filter` and `evidence`. Every update leaves a receipt.
"""
