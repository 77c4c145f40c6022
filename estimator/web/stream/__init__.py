"""Stream of corrected rates for any program: a WebSocket and a long poll at /api/v1/stream."""
