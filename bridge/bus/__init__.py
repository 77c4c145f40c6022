"""Message bus: the interface to publish, subscribe and query, and its implementation on the zenoh protocol.

Begin at `contract`. `zenoh_bus` implements the interface; `gap_repair` fetches messages that a subscription missed.
"""
