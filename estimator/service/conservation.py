"""Conservation law: every sample that came in went out, or was dropped and counted with a reason. Pure."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

EVENT = "conservation law broken"


class SampleAccount(NamedTuple):
    """Sample counts of one device: `came` in, corrected (`out`), `dropped`, and published or still to be (`said`).

    `refused` samples came from another bridge and were never admitted. `held` samples wait for their turn to be
    admitted.
    """

    came: int = 0
    out: int = 0
    dropped: int = 0
    said: int = 0
    refused: int = 0
    held: int = 0

    @property
    def unaccounted(self) -> int:
        """Samples that came in and are neither out nor dropped; negative where more went out than came in."""
        return self.came - self.out - self.dropped

    @property
    def unsaid(self) -> int:
        """Corrected samples never published; negative where samples were published and also counted as dropped."""
        return self.out - self.said


def combined(accounts: Iterable[SampleAccount]) -> SampleAccount:
    """Sum of the accounts of several devices."""
    return SampleAccount(*map(sum, zip(*accounts, strict=True)))


class Conservation:
    """Checks the sample accounts of all devices repeatedly; remembers reported violations and forgotten devices."""

    def __init__(self) -> None:
        self.violations: dict[str, int] = {}
        self.total = SampleAccount()
        self._last: dict[str, SampleAccount] = {}
        self._gone = SampleAccount()
        self._told: dict[str, tuple[int, int]] = {}

    def leave(self, name: str) -> None:
        """Remove a device, with its account at the last check; another device may take its name later."""
        self._gone = combined([self._gone, self._last.pop(name, SampleAccount())])
        self._told.pop(name, None)

    def check(self, accounts: Mapping[str, SampleAccount], decoded: int, turned_away: int) -> dict[str, str]:
        """New violations in words, by device; the key "" is for the ward as a whole.

        decoded: samples decoded by the service. turned_away: decoded samples that went to no device, counted with a
        reason.
        """
        for name in self._last.keys() - accounts.keys():
            self.leave(name)
        self._last = dict(accounts)
        self.total = combined([*accounts.values(), self._gone])
        wrong = [(name, (account.unaccounted, account.unsaid)) for name, account in accounts.items()]
        wrong.append(("", (decoded - self.total.came - self.total.refused - self.total.held - turned_away, 0)))
        fresh = {name: found for name, found in wrong if found != self._told.get(name, (0, 0))}
        self._told |= fresh
        said = {name: _words(found) for name, found in fresh.items() if any(found)}
        for name in said:
            self.violations[name] = self.violations.get(name, 0) + 1
        return said


def _words(found: tuple[int, int]) -> str:
    unaccounted, unsaid = found
    parts = [f"{unaccounted} samples came and are neither out nor dropped"] if unaccounted else []
    return "; ".join(parts + ([f"{unsaid} samples count as out and were not published"] if unsaid else []))
