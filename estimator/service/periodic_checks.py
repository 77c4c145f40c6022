"""Periodic checks, once a second: conservation of samples, and the snapshot for health and metrics.

Conservation law: every sample received was corrected and published, or was dropped and counted with a reason.
"""

import logging
from collections import Counter
from collections.abc import Sequence
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
    """Sample counts of one device: `came` (received), `out` (corrected and published), and `dropped` with a reason.

    `refused` samples were sent by a bridge other than the owner and are not part of `came`.
    """

    came: int
    out: int
    dropped: int
    refused: int


class PeriodicChecks:
    """Once-a-second checker: compares numbers of samples in, out and dropped, and takes the service's health snapshot.

    counts: the ward's counts of refused and lost messages. vitals: receives the health snapshot.
    """

    def __init__(self, devices: DeviceRoster, counts: Tally, vitals: ServiceHealth) -> None:
        self._devices, self._counts, self._vitals = devices, counts, vitals
        #: violations of the law found so far, and samples unaccounted for at the last check, by device; "" is the ward
        self._violations = Counter[str]()
        self._unaccounted: dict[str, int] = {}
        self._last: dict[str, SampleAccount] = {}
        self._decoded = self._gone = 0  # samples decoded, and samples that came from devices that have left
        self._seen: dict[str, DeviceHealth] = {}
        self._logged: dict[str, int] = {}  # counts in the last log line with totals, and when the next is due
        self._next_s = float("-inf")

    def came(self, samples: int) -> None:
        """Add `samples` to the number of decoded samples, which `check` compares with the counts of all devices."""
        self._decoded += samples

    def check(self) -> None:
        """Check the conservation law: every sample received was published, or was dropped with a reason.

        Call it between two rounds of the run loop. Each new violation is counted, and logged once per device.
        """
        accounts = {name: _account(device) for name, device in self._devices.items()}
        for name in self._last.keys() - accounts.keys():
            self._leave(name)
        self._last, counts, before = accounts, self._counts.as_dict(), self._unaccounted
        here = sum(one.came + one.refused for one in accounts.values()) + self._gone
        turned_away = counts.get(TOO_MANY, 0) + counts.get(DONE, 0)
        self._unaccounted = {name: one.came - one.out - one.dropped for name, one in accounts.items()}
        self._unaccounted[""] = self._decoded - turned_away - here
        for name, n in self._unaccounted.items():
            if n not in (0, before.get(name, 0)):
                self._broken(name, n)

    def _broken(self, name: str, samples: int) -> None:
        """Report samples that are neither out nor dropped; negative where more went out than came in."""
        self._counts.add(EVENT)
        self._violations[name] += 1
        if self._violations[name] == 1:
            words = "%s: %s: %d samples were received, but neither published nor dropped (further cases are counted, not logged)"
            log.error(words, name or "the ward", EVENT, samples)
        for device in [self._devices[name]] if name else self._devices.values():
            device.session.count_event(EVENT)

    def remove(self, devices: Sequence[Device]) -> None:
        """Remove devices from the roster, and from the count of samples in and out."""
        self.check()  # while the devices still count
        for device in devices:
            self._leave(device.name)
            del self._devices[device.name]

    def _leave(self, name: str) -> None:
        """Keep only the sum of a device's samples at the last check: another device may take its id later."""
        account = self._last.pop(name)
        self._gone += account.came + account.refused
        self._unaccounted.pop(name, None)

    def see(self, device: Device) -> None:
        """Record the health of a device for the next snapshot, if the device has published a status."""
        if device.latest is not None:
            nis, violations = device.session.tracker.doubt.consistency.mean_nis, self._violations[device.name]
            needs = needs_person(device.latest, device.session.info)
            kinds = tuple(one.kind for one in device.board.standing)
            self._seen[device.name] = DeviceHealth(device.latest, nis, device.delay(), violations, needs, kinds)

    def note(
        self, now: float, store: str, counts: dict[str, int], *, connected: bool, busy: float, alerts: tuple[str, ...]
    ) -> None:
        """Publish the health snapshot of all devices in the roster, and log the totals.

        now: monotonic time, s. connected: whether a router is connected. store: why the store cannot be written, or
        empty. counts: the ward's counts of refused and lost messages.
        busy: working share of the loop, 0 to 1. alerts: kinds of the estimator's own alerts that have not ended.
        """
        self.log(now, counts)
        devices = {name: seen for name, seen in self._seen.items() if name in self._devices}
        self._seen = dict(devices)
        self._vitals.note(Note(now, connected, store, devices, self._violations.total(), counts, busy, alerts))

    def log(self, now: float, counts: dict[str, int], *, last: bool = False) -> None:
        """Log the counts if they changed since the last log line, at most every TOLD_S seconds unless `last`.

        now: monotonic time, s.
        """
        if counts == self._logged or (now < self._next_s and not last):
            return
        self._logged, self._next_s = counts, now + TOLD_S
        log.warning("so far: %s", ", ".join(f"{label} {n}" for label, n in sorted(counts.items())))


def _account(device: Device) -> SampleAccount:
    sequence = device.session.sequence
    return SampleAccount(device.came, device.told, sequence.dropped.total(), sequence.events.total(ELSEWHERE))
