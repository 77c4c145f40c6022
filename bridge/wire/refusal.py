"""Refusals of messages and samples: reasons, the exception, and the tally that counts refusals."""

from collections import Counter
from enum import StrEnum


class Reason(StrEnum):
    """Reasons for refusing external input; the value is the label under which refusals are counted."""

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
    """External input was refused.

    reason: label under which the refusal is counted. detail: text that states the received value and the expected one.
    """

    def __init__(self, reason: Reason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason
        self.detail = detail


class Tally:
    """Counter by label, for example of refused messages by reason.

    Not thread-safe: one thread owns a tally and publishes copies.
    """

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def add(self, label: str, n: int = 1) -> int:
        """Add n to a label's count and return the new count."""
        self._counts[label] += n
        return self._counts[label]

    def as_dict(self) -> dict[str, int]:
        """Return all counts above zero, by label, as a copy."""
        return {label: n for label, n in self._counts.items() if n}

    def total(self, begin: str = "") -> int:
        """Return the sum of all counts whose labels start with `begin`; the default is all labels."""
        if not begin:
            return sum(self._counts.values())
        return sum([n for label, n in self._counts.items() if label.startswith(begin)])
