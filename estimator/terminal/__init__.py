"""Live views in a terminal: a ward, one device, a guided calibration.

Start reading at `watch_ward`.
"""
