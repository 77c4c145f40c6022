"""Bias tracking in one boot: a Kalman filter with a consistent covariance, and one file for each kind of evidence.

Reading order: `tracker`, then `tracked_bias`, `bias_filter` and `evidence`. Every update leaves a receipt.
"""
