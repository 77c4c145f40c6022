"""Calibration and correction of recordings with the same code as live, and the files of the results.

Start reading at `recordings`.
"""
