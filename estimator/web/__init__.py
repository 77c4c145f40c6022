"""The dashboard: pure views of what the bus says, frames encoded once for all viewers, a small server.

Begin at `ward_state` (all that was heard) and `app`.
"""
