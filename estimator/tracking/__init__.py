"""Bias tracking in one boot: a Kalman filter with a consistent covariance, and one file for each kind of evidence.

Evidence is a measurement for the filter. Every update returns a receipt: innovation, its covariance, test ratio, and if
it was accepted.
Reading order: `tracker`, then `tracked_bias`, `bias_filter` and `evidence`.
"""
