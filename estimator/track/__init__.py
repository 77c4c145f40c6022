"""Tracking: the bias filter and the evidence that feeds it."""
