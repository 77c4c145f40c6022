"""Reports on calibrations, corrections, histories and noise: in words, as tables and as JSON.

One file per subject. Degrees are used here; the computing rooms use SI only.
"""
