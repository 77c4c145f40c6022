"""Calibration and correction of recordings with the code of the live service, and the files of the results.

Start reading at `recordings`.
"""
