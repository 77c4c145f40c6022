"""Web dashboard of a ward: pure views of the bus's messages, frames encoded once for all viewers, and a small server.

Begin at `ward_state` (everything heard) and `app`.
"""
