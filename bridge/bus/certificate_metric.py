"""Prometheus metric: expiry time of this program's certificate."""

from collections.abc import Iterator

from bridge.bus.routers import Routers
from bridge.runtime.health_server import MetricFamily


def certificate(routers: Routers) -> Iterator[MetricFamily]:
    """Yield the expiry time (s since the Unix epoch), if there is a certificate. Rereads the file: renewal may replace it."""
    lasts = routers.lasts()
    if lasts is not None:
        help_ = "When this program's certificate ends, or one above it."
        yield MetricFamily("certificate_ends_timestamp_seconds", help_, (), {(): lasts.ends.timestamp()})
