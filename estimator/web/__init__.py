"""The dashboard, a ward on a page: pure views of what the bus says, frames encoded once for all viewers, a small server."""
