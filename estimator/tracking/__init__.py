"""The bias of one boot from its first sample on, with an honest uncertainty: a Kalman filter, and one kind of evidence a file.

Begin at `tracker`, then `bias_filter` and `evidence`. Every update leaves a receipt.
"""
