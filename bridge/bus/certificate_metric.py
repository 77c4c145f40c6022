"""The metric of when a program's certificate expires."""

from collections.abc import Iterator

from bridge.bus.routers import Routers
from bridge.runtime.health_server import MetricFamily


def certificate(routers: Routers) -> Iterator[MetricFamily]:
    """When this program's certificate ends, if it has one; read again each time, because it may have been renewed."""
    lasts = routers.lasts()
    if lasts is not None:
        help_ = "When this program's certificate ends, or one above it."
        yield MetricFamily("certificate_ends_timestamp_seconds", help_, (), {(): lasts.ends.timestamp()})
