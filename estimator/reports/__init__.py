"""Calibrations, corrections, histories and noise in words, as tables and as JSON. Degrees live here, not in the core.

One subject a file.
"""
