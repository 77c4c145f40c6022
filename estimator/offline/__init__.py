"""Calibrates and corrects recordings with the same code as live, and reads and writes the resulting files.

Start reading at `recordings`.
"""
