"""Batch calibration: stages of a session in, an estimate with a verdict out."""
