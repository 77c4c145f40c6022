"""Health and metrics of a bridge for its HTTP server, from the last DeviceInfo of each device."""

import time
from collections.abc import Callable, Iterator, Sequence

from bridge.bus.certificate_metric import certificate
from bridge.bus.routers import Routers
from bridge.runtime.health_server import HealthSource, MetricFamily
from bridge.wire.messages import DeviceInfo

#: seconds without publishing after which the pump counts as stuck
STUCK_S = 5.0


class BridgeHealth:
    """Health and metrics of a bridge, for its HTTP server.

    infos: returns the last DeviceInfo of each device. turned_s: returns the time at which the bridge last published, s
    of the monotonic clock. connected: returns True if a router is connected. routers: router endpoints and certificate.
    """

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
        """Callbacks for the health server: metrics, liveness (`sick`) and readiness (`unready`)."""
        return HealthSource(self.families, self.sick, self.unready)

    def sick(self) -> list[str]:
        """Return why the bridge is not alive, as texts; [] if it is alive.

        The bridge is not alive if it has published nothing for more than 5 s.
        """
        age = time.monotonic() - self._turned_s()
        return [f"no message published for {age:.0f} s"] if age > STUCK_S else []

    def unready(self) -> list[str]:
        """Return why the bridge cannot do its work now, as texts; [] if it can.

        The bridge must be alive and connected to a router. If devices are known, at least one must send samples.
        Without a router, the faults of the certificate are added.
        """
        why = self.sick()
        if not self._connected():
            why += ["the router is gone", *self._routers.faults()]
        infos = self._infos()
        if infos and not any(info.boot and not info.trouble for info in infos):
            why.append("no device is heard")
        return why

    def families(self) -> Iterator[MetricFamily]:
        """Yield all metrics of the bridge for Prometheus, with the labels device and, for dropped samples, reason."""
        infos = self._infos()
        yield from certificate(self._routers)
        yield MetricFamily(
            "bridge_connected", "1 if the bridge is connected to a router, else 0.", (), {(): float(self._connected())}
        )
        heard = {(i.device,): float(bool(i.boot) and not i.trouble) for i in infos}
        yield MetricFamily("bridge_device_connected", "1 if the device sends samples, else 0.", ("device",), heard)
        read = {(i.device,): float(i.samples) for i in infos}
        yield MetricFamily(
            "bridge_samples", "Samples read in the current boot of the device.", ("device",), read, counter=True
        )
        rate = {(i.device,): i.measured_rate_hz for i in infos}
        yield MetricFamily("bridge_rate_hz", "Measured sample rate, Hz.", ("device",), rate)
        battery = {(i.device,): i.battery_percent for i in infos if i.battery_percent == i.battery_percent}
        yield MetricFamily("bridge_battery_percent", "Charge of the device's battery, percent.", ("device",), battery)
        dropped = {(i.device, reason): float(n) for i in infos for reason, n in i.dropped.items()}
        yield MetricFamily(
            "bridge_samples_dropped",
            "Samples or bytes dropped, by reason.",
            ("device", "reason"),
            dropped,
            counter=True,
        )
