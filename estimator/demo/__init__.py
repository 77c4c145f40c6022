"""Demonstration: a small ward of virtual devices, run for about a minute and compared with the simulator's truth.

Begin at `run`.
"""


class DemoFailed(Exception):
    """A process of the demonstration did not start, or stopped; the message names it and quotes the end of its log."""
