"""Bridge: reads gyroscopes and publishes their samples on zenoh. Also defines the wire format. Never imports `estimator`.

docs/architecture.md maps the packages. Begin at `ingest` for the path of a sample, and at `wire.messages` for the
messages on the bus.
"""
