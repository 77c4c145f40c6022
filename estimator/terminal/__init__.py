"""Live views in a terminal: a ward, one device, a guided calibration.

Begin at `watch_ward`.
"""
