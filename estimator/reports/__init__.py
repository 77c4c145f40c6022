"""Reports on calibrations, corrections, histories and noise: as sentences, tables and JSON.

One file per subject. Sentences and tables use degrees, JSON uses SI units.
"""
