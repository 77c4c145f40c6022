"""The message bus: a contract, and its implementation on zenoh.

Begin at `contract`. `zenoh_bus` implements the contract; `gap_repair` fetches messages that a subscription missed.
"""
