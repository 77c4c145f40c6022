"""The demonstration: a whole small ward in about a minute, judged against the simulator's truth.

Begin at `run`.
"""
