"""Periodic checks, once a second: the conservation law, and the snapshot for health and metrics.

The law: every sample that came in went out, or was dropped and counted with a reason.
"""

import logging
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from bridge.wire.refusal import Tally
from estimator.device.admission import ELSEWHERE
from estimator.device.attention import needs_person
from estimator.service.device import Device
from estimator.service.device_roster import TOO_MANY, DeviceRoster
from estimator.service.health import DeviceHealth, Note, ServiceHealth
from estimator.service.replay_log import DONE

log = logging.getLogger(__name__)

#: event of a device, or of all devices, where the law is broken
EVENT = "conservation law broken"
#: shortest interval between log lines with totals, s
TOLD_S = 10.0


class SampleAccount(NamedTuple):
    """Sample counts of one device: `came` in, `out` corrected and published, and `dropped` with a reason.

    `refused` samples came from another bridge and do not count as `came`.
    """

    came: int = 0
    out: int = 0
    dropped: int = 0
    refused: int = 0

    @property
    def unaccounted(self) -> int:
        """Number of samples that came in and are neither out nor dropped; negative where more went out than came in."""
        return self.came - self.out - self.dropped


class Conservation:
    """Checker of the conservation law (samples in = out + dropped) for all devices.

    `violations`: number of violations found so far by device; the key "" is for the ward as a whole.
    """

    def __init__(self) -> None:
        self.violations: dict[str, int] = {}
        self._last: dict[str, SampleAccount] = {}
        self._gone = 0  # samples that came from devices that have left
        self._told: dict[str, int] = {}

    def leave(self, name: str) -> None:
        """Remove a device and its sample counts at the last check; another device may take its id later."""
        account = self._last.pop(name, SampleAccount())
        self._gone += account.came + account.refused
        self._told.pop(name, None)

    def check(self, accounts: Mapping[str, SampleAccount], decoded: int, turned_away: int) -> dict[str, int]:
        """Find new violations of the law: samples unaccounted for, by device; the key "" is for the whole ward.

        accounts: by device. decoded: samples decoded by the service. turned_away: decoded samples that went to no
        device, counted with a reason.
        """
        for name in self._last.keys() - accounts.keys():
            self.leave(name)
        self._last = dict(accounts)
        wrong = {name: account.unaccounted for name, account in accounts.items()}
        wrong[""] = decoded - turned_away - self._gone - sum(one.came + one.refused for one in accounts.values())
        fresh = {name: n for name, n in wrong.items() if n != self._told.get(name, 0)}
        self._told |= fresh
        found = {name: n for name, n in fresh.items() if n}
        for name in found:
            self.violations[name] = self.violations.get(name, 0) + 1
        return found


class PeriodicChecks:
    """Checker, once a second: compares samples in with samples out and dropped, and notes the service's health.

    counts: the ward's counts. vitals: takes the health snapshot.
    """

    def __init__(self, devices: DeviceRoster, counts: Tally, vitals: ServiceHealth) -> None:
        self._devices, self._counts, self._vitals = devices, counts, vitals
        self._law = Conservation()
        self._decoded = 0
        self._seen: dict[str, DeviceHealth] = {}
        self._logged: dict[str, int] = {}  # counts in the last log line with totals, and when the next is due
        self._next_s = float("-inf")

    def came(self, samples: int) -> None:
        """Add the number of samples that were decoded."""
        self._decoded += samples

    def check(self) -> None:
        """Check the conservation law between two rounds; each new violation is counted, and logged once per device.

        The law: every sample that came in went out, or was dropped with a reason.
        """
        accounts = {name: _account(device) for name, device in self._devices.items()}
        counts = self._counts.as_dict()
        turned_away = counts.get(TOO_MANY, 0) + counts.get(DONE, 0)
        for name, n in self._law.check(accounts, self._decoded, turned_away).items():
            self._counts.add(EVENT)
            if self._law.violations[name] == 1:
                words = "%s: %s: %d samples came and are neither out nor dropped (more are only counted)"
                log.error(words, name or "the ward", EVENT, n)
            for device in [self._devices[name]] if name else self._devices.values():
                device.session.count_event(EVENT)

    def remove(self, devices: Sequence[Device]) -> None:
        """Take devices out of the roster, and out of the count of samples in and out."""
        self.check()  # while the devices still count
        for device in devices:
            self._law.leave(device.name)
            del self._devices[device.name]

    def see(self, device: Device) -> None:
        """Note the health of a device for the next snapshot, once it has published a status."""
        if device.latest is not None:
            nis, violations = (
                device.session.tracker.doubt.consistency.mean_nis,
                self._law.violations.get(device.name, 0),
            )
            needs = needs_person(device.latest, device.session.info)
            kinds = tuple(one.kind for one in device.board.standing)
            self._seen[device.name] = DeviceHealth(device.latest, nis, device.delay(), violations, needs, kinds)

    def note(
        self, now: float, store: str, counts: dict[str, int], *, connected: bool, busy: float, alerts: tuple[str, ...]
    ) -> None:
        """Publish the health snapshot, with the last noted health of every device still in the roster; log the totals.

        now: monotonic s. store: why the store cannot be written, or empty. busy: working share of the loop, 0 to 1.
        alerts: kinds of the estimator's own standing alerts.
        """
        self.log(now, counts)
        devices = {name: seen for name, seen in self._seen.items() if name in self._devices}
        self._seen = dict(devices)
        violations = sum(self._law.violations.values())
        self._vitals.note(Note(now, connected, store, devices, violations, counts, busy, alerts))

    def log(self, now: float, counts: dict[str, int], *, last: bool = False) -> None:
        """Log the counts if they changed since the last log line, at most every TOLD_S unless `last`.

        now: monotonic s.
        """
        if counts == self._logged or (now < self._next_s and not last):
            return
        self._logged, self._next_s = counts, now + TOLD_S
        log.warning("so far: %s", ", ".join(f"{label} {n}" for label, n in sorted(counts.items())))


def _account(device: Device) -> SampleAccount:
    sequence = device.session.sequence
    return SampleAccount(device.came, device.told, sequence.dropped.total(), sequence.events.total(ELSEWHERE))
