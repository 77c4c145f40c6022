"""Conservation law: every sample that came in went out, or was dropped and counted with a reason. Pure."""

from collections.abc import Mapping
from typing import NamedTuple

EVENT = "conservation law broken"


class SampleAccount(NamedTuple):
    """Sample counts of one device: `came` in, `out` corrected and published, and `dropped`.

    `refused` samples came from another bridge and do not count as `came`.
    """

    came: int = 0
    out: int = 0
    dropped: int = 0
    refused: int = 0

    @property
    def unaccounted(self) -> int:
        """Samples that came in and are nowhere; negative where more went out than came in."""
        return self.came - self.out - self.dropped


class Conservation:
    """Checks the sample accounts of all devices repeatedly; remembers reported violations and forgotten devices."""

    def __init__(self) -> None:
        self.violations: dict[str, int] = {}
        self._last: dict[str, SampleAccount] = {}
        self._gone = 0  # samples that came from devices that have left
        self._told: dict[str, int] = {}

    def leave(self, name: str) -> None:
        """Remove a device, with its account at the last check; another device may take its name later."""
        account = self._last.pop(name, SampleAccount())
        self._gone += account.came + account.refused
        self._told.pop(name, None)

    def check(self, accounts: Mapping[str, SampleAccount], decoded: int, turned_away: int) -> dict[str, int]:
        """New violations, as samples unaccounted for, by device; the key "" is for the ward as a whole.

        decoded: samples decoded by the service. turned_away: decoded samples that went to no device, counted with a
        reason.
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
