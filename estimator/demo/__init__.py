"""Demonstration: a small ward of virtual devices, run for about a minute and judged against the simulator's truth.

Begin at `run`.
"""
