"""Health of the service for /metrics, /healthz and /readyz: recorded once a second, read from any thread."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from bridge.bus.certificate_metric import certificate
from bridge.bus.routers import Routers
from bridge.runtime.health_server import HealthSource, MetricFamily
from bridge.wire.messages import State, Status
from estimator.device.lifecycle import AWAY, NEVER_S

#: a loop that has not turned for this long is stuck, s
STUCK_S = 5.0


class DeviceHealth(NamedTuple):
    """Health of one device for metrics and alerts.

    status: the latest one published. nis: mean normalised innovation squared per degree of freedom; about 1 for a
    consistent filter. latency_s: seconds from a sample's receipt to its publication, NaN if unknown.
    violations: how often received = corrected + dropped did not hold. needs_person: whether a person has to act.
    alerts: kinds of the alerts that have not ended.
    """

    status: Status
    nis: float
    latency_s: float
    violations: int
    needs_person: bool
    alerts: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Note:
    """Snapshot of the service's health.

    time_s: monotonic time, s. connected: whether a router is connected. store: why the store cannot be written, or
    empty.
    devices: health by device id. violations: how often received = corrected + dropped did not hold, over all devices.
    counts: refused and lost messages and samples, by cause. busy: working share of the loop's last second, 0 to 1.
    alerts: kinds of the estimator's own alerts that have not ended.
    """

    time_s: float
    connected: bool
    store: str
    devices: Mapping[str, DeviceHealth] = field(default_factory=dict)
    violations: int = 0
    counts: Mapping[str, int] = field(default_factory=dict)
    busy: float = 0.0
    alerts: tuple[str, ...] = ()


class ServiceHealth:
    """Holder of the latest health snapshot; answers for /metrics, /healthz and /readyz.

    expects: whether the ward file lists devices; if so, the service is not ready while no device sends usable samples.
    clock: returns monotonic time, s.
    """

    def __init__(
        self, *, expects: bool = False, clock: Callable[[], float] = time.monotonic, routers: Routers | None = None
    ) -> None:
        self._expects, self._clock = expects, clock
        #: routers of the bus connection, with their certificates
        self.routers = routers or Routers(())
        self._note: Note | None = None

    def note(self, note: Note) -> None:
        """Replace the health snapshot. Any thread may read at the same time and gets the old or the new snapshot."""
        self._note = note

    @property
    def asked(self) -> HealthSource:
        """Callbacks for a health server: `families` for metrics, `sick` for /healthz, `unready` for /readyz."""
        return HealthSource(self.families, self.sick, self.unready)

    def sick(self) -> list[str]:
        """Return the faults that make /healthz report the process as not alive; empty while it is alive.

        It is not alive if its loop has made no snapshot for more than STUCK_S seconds. A process that waits for its
        first router counts as alive.
        """
        age = 0.0 if self._note is None else self._clock() - self._note.time_s
        return [f"the service's loop has been stuck for {age:.0f} s"] if age > STUCK_S else []

    def unready(self) -> list[str]:
        """Return the faults that keep the service from working now, such as a missing router, for /readyz; or empty."""
        note = self._note
        if note is None:
            return ["no router yet", *self.routers.faults()]
        why = self.sick()
        if not note.connected:
            why += ["the router is gone", *self.routers.faults()]
        if note.store:
            why.append(note.store)
        states = {d.status.state for d in note.devices.values()}
        if self._expects and states <= {State.LOST}:
            why.append("no device is heard")
        elif self._expects and note.connected and states <= set(AWAY):
            why.append("no device sends usable samples")
        return why

    def families(self) -> Iterator[MetricFamily]:
        """Yield all metrics of the service, labelled by device, reason, state, event, kind or quality."""
        yield from certificate(self.routers)
        note = self._note
        yield MetricFamily(
            "bus_connected",
            "1 while the estimator is connected to a router, else 0.",
            (),
            {(): float(note is not None and note.connected)},
        )
        if note is None:
            return
        yield MetricFamily(
            "loop_age_seconds",
            "Seconds since the last round of the service's loop.",
            (),
            {(): self._clock() - note.time_s},
        )
        yield MetricFamily(
            "busy_ratio", "Share of the last second in which the service's loop worked, 0 to 1.", (), {(): note.busy}
        )
        yield MetricFamily(
            "store_writable", "1 while the store can be written, else 0.", (), {(): float(not note.store)}
        )
        states = Counter(d.status.state.name.lower() for d in note.devices.values())
        yield MetricFamily(
            "devices",
            "Number of devices in each state.",
            ("state",),
            {(s.name.lower(),): states[s.name.lower()] for s in State},
        )
        yield MetricFamily(
            "ward_events",
            "Events of the ward, such as messages and samples refused or lost, by cause.",
            ("event",),
            {(label,): n for label, n in note.counts.items()},
            counter=True,
        )
        yield MetricFamily(
            "law_violations_all",
            "Times that samples received differed from corrected + dropped, on the whole ward; should stay 0.",
            (),
            {(): note.violations},
            counter=True,
        )
        yield from _of_devices(note.devices)
        subjects = {name: device.alerts for name, device in note.devices.items()} | {"": note.alerts}
        yield MetricFamily(
            "alert",
            "1 for each standing alert; the label device is empty for an alert of the estimator itself. See docs/alerts.md.",
            ("device", "kind"),
            {(name, kind): 1.0 for name, kinds in subjects.items() for kind in kinds},
        )


def _of_devices(devices: Mapping[str, DeviceHealth]) -> Iterator[MetricFamily]:
    def family(name: str, words: str, value: Callable[[DeviceHealth], float], *, counter: bool = False) -> MetricFamily:
        values = {(device,): value(vitals) for device, vitals in devices.items()}
        known = {labels: value for labels, value in values.items() if not math.isnan(value)}
        return MetricFamily(name, words, ("device",), known, counter)

    yield family("samples_in", "Samples received.", lambda d: d.status.samples_in, counter=True)
    yield family("samples_out", "Samples corrected.", lambda d: d.status.samples_out, counter=True)
    dropped = {(name, why): n for name, d in devices.items() for why, n in d.status.dropped.items()}
    yield MetricFamily("samples_dropped", "Samples dropped.", ("device", "reason"), dropped, counter=True)
    yield family("gaps", "Gaps in the sample numbers.", lambda d: d.status.events.get("gaps", 0), counter=True)
    yield family(
        "samples_missing",
        "Samples that never arrived.",
        lambda d: d.status.events.get("missing_samples", 0),
        counter=True,
    )
    yield family(
        "law_violations",
        "Times that samples received differed from corrected + dropped, of a device; should stay 0.",
        lambda d: d.violations,
        counter=True,
    )
    yield family("needs_person", "1 if the device needs a person, else 0.", lambda d: d.needs_person)
    yield family("rate_hz", "Samples per second of the device's clock.", lambda d: d.status.rate_hz)
    yield family(
        "latency_seconds", "Seconds from a sample's receipt at the bridge to its publication.", lambda d: d.latency_s
    )
    yield family(
        "evidence_age_seconds",
        "Seconds since the last measurement of the bias; missing before the first.",
        _evidence_age,
    )
    yield family(
        "nis",
        "Mean normalised innovation squared per degree of freedom; about 1 if the filter states its uncertainty correctly.",
        lambda d: d.nis,
    )
    yield family(
        "bias_std_rad_s", "Standard deviation of the bias on the worst axis, rad/s.", lambda d: max(d.status.bias_std)
    )
    yield family("temperature_celsius", "Temperature of the device, °C.", lambda d: d.status.temperature_c)
    state = {(name, d.status.state.name.lower()): 1.0 for name, d in devices.items()}
    yield MetricFamily("state", "1 for the present state of a device.", ("device", "state"), state)
    quality = {(name, d.status.quality.name.lower()): 1.0 for name, d in devices.items()}
    yield MetricFamily(
        "quality", "1 for the present quality of a device's corrected rates.", ("device", "quality"), quality
    )


def _evidence_age(of: DeviceHealth) -> float:
    age_s = of.status.evidence_age_s
    return age_s if age_s < NEVER_S else math.nan
