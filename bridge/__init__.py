"""Devices in, samples on zenoh out; owns the wire format. Never imports `estimator`.

docs/architecture.md maps the rooms; begin at `ingest` for a sample's way and at `wire.messages` for what is published.
"""
