"""Demonstration: a small ward of virtual devices, run for about a minute and judged against the simulator's truth.

Begin at `run`.
"""


class DemoFailed(Exception):
    """Raised when a process of the demonstration did not start, or stopped: names it and quotes the end of its log."""
