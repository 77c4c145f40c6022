"""A bridge's health and metrics for the HTTP server, from the last DeviceInfo of each device."""

import time
from collections.abc import Callable, Iterator, Sequence

from bridge.bus.certificate_metric import certificate
from bridge.bus.routers import Routers
from bridge.runtime.health_server import HealthSource, MetricFamily
from bridge.wire.messages import DeviceInfo

#: a pump that has not turned for so long is stuck
STUCK_S = 5.0


class BridgeHealth:
    """infos: what was said last of each device; turned_s: when the pump turned last, monotonic; connected: to one of routers."""

    def __init__(
        self,
        infos: Callable[[], Sequence[DeviceInfo]],
        turned_s: Callable[[], float],
        connected: Callable[[], bool],
        routers: Routers | None = None,
    ) -> None:
        self._infos, self._turned_s, self._connected = infos, turned_s, connected
        self._routers = routers or Routers(())

    @property
    def asked(self) -> HealthSource:
        """What a health server answers."""
        return HealthSource(self.families, self.sick, self.unready)

    def sick(self) -> list[str]:
        """Why it is not alive."""
        age = time.monotonic() - self._turned_s()
        return [f"nothing was published for {age:.0f} s"] if age > STUCK_S else []

    def unready(self) -> list[str]:
        """Why it cannot do its work now."""
        why = self.sick()
        if not self._connected():
            why += ["the router is gone", *self._routers.faults()]
        infos = self._infos()
        if infos and not any(info.boot and not info.trouble for info in infos):
            why.append("no device is heard")
        return why

    def families(self) -> Iterator[MetricFamily]:
        """All metrics; a label a device of the configuration, and the reasons of drops."""
        infos = self._infos()
        yield from certificate(self._routers)
        yield MetricFamily("bridge_connected", "Whether there is a router.", (), {(): float(self._connected())})
        heard = {(i.device,): float(bool(i.boot) and not i.trouble) for i in infos}
        yield MetricFamily("bridge_device_connected", "Whether a device sends samples.", ("device",), heard)
        read = {(i.device,): float(i.samples) for i in infos}
        yield MetricFamily("bridge_samples", "Samples read in this boot.", ("device",), read, counter=True)
        rate = {(i.device,): i.measured_rate_hz for i in infos}
        yield MetricFamily("bridge_rate_hz", "Samples a second, as measured.", ("device",), rate)
        battery = {(i.device,): i.battery_percent for i in infos if i.battery_percent == i.battery_percent}
        yield MetricFamily("bridge_battery_percent", "Charge of a device.", ("device",), battery)
        dropped = {(i.device, reason): float(n) for i in infos for reason, n in i.dropped.items()}
        yield MetricFamily(
            "bridge_samples_dropped", "Samples or bytes dropped.", ("device", "reason"), dropped, counter=True
        )
