"""Web dashboard of a ward: views of the bus's messages, frames encoded once for all viewers, and an HTTP server.

Start reading at `ward_state` (the collected messages) and `app`.
"""
