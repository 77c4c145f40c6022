"""Reasons for refused messages and samples, and the tally that counts them."""

from collections import Counter
from enum import StrEnum


class Reason(StrEnum):
    """Why something from outside was not taken; the value is the label under which it is counted."""

    BAD_KEY = "bad_key"
    WILDCARD_KEY = "wildcard_key"
    BAD_ID = "bad_id"
    FOREIGN_ID = "foreign_id"
    TOO_LARGE = "too_large"
    MALFORMED = "malformed"
    VERSION = "version"
    LENGTH = "length"
    NON_FINITE = "non_finite"
    RANGE = "range"
    DUPLICATE = "duplicate"
    REORDERED = "reordered"
    BACKWARD = "backward_time"
    OLD_BOOT = "old_boot"
    OVERFLOW = "overflow"


class Refusal(Exception):
    """A door said no. `reason` is counted, `detail` says what came and what was expected."""

    def __init__(self, reason: Reason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason
        self.detail = detail


class Tally:
    """Counts by label. A plain counter with one owner; copy it to publish it."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def add(self, label: str, n: int = 1) -> int:
        """Count n more and return the new total of this label."""
        self._counts[label] += n
        return self._counts[label]

    def as_dict(self) -> dict[str, int]:
        """A copy of all counts above zero."""
        return {label: n for label, n in self._counts.items() if n}

    def total(self, begin: str = "") -> int:
        """All counts together, of labels that begin so."""
        if not begin:
            return sum(self._counts.values())
        return sum([n for label, n in self._counts.items() if label.startswith(begin)])
