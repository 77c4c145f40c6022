"""Recordings calibrated and corrected as a ward does it live, and the files of both.

Begin at `recordings`.
"""
