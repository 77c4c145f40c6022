"""Metrics in Prometheus' text format. The only module that imports prometheus_client."""

from collections.abc import Iterator
from importlib.metadata import version

from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4 as KIND

from bridge.runtime.health_server import HealthSource

__all__ = ["KIND", "rendered"]


def rendered(asked: HealthSource) -> bytes:
    """Return a program's current metrics as UTF-8 in Prometheus' text format.

    asked: callbacks that give the program's own metrics. CPU, memory and open files of the process are added.
    """
    registry = CollectorRegistry()
    registry.register(_Collector(asked))
    ProcessCollector(registry=registry)
    return generate_latest(registry)


class _Collector:
    def __init__(self, asked: HealthSource) -> None:
        self._asked = asked

    def collect(self) -> Iterator[Metric]:
        build = GaugeMetricFamily("truerate_build_info", "1, for the version of the program.", labels=("version",))
        build.add_metric((version("truerate"),), 1.0)
        yield build
        for family in self._asked.families():
            kind = CounterMetricFamily if family.counter else GaugeMetricFamily
            metric = kind("truerate_" + family.name, family.help, labels=family.labels)
            for labels, value in family.values.items():
                metric.add_metric(labels, value)
            yield metric
