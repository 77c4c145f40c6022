"""Prometheus metric with the expiry time of this program's certificate."""

from collections.abc import Iterator
from dataclasses import replace

from bridge.bus.routers import Routers
from bridge.runtime.health_server import MetricFamily

#: metric of the certificate's expiry time, still without a value
ENDS = MetricFamily(
    "certificate_ends_timestamp_seconds",
    "Expiry time of the program's certificate, s since 1970; only with certificates.",
)


def certificate(routers: Routers) -> Iterator[MetricFamily]:
    """Yield one Prometheus metric with the certificate's expiry time, s since the Unix epoch; nothing without certificate.

    routers: gives the certificate. Reads the certificate file at each call, because a renewal may replace the file.
    """
    lasts = routers.lasts()
    if lasts is not None:
        yield replace(ENDS, values={(): lasts.ends.timestamp()})
