"""All that a subscriber saw of a ward, and what was done to it meanwhile; written by the run, read by the checker."""

from collections import defaultdict
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from bridge.wire.messages import Calibration, CorrectedBatch, Quality, Status, Verdict
from estimator.client import Miss

Boot = tuple[str, int]


class Heard(NamedTuple):
    """A batch, and when it came, monotonic s."""

    time_s: float
    batch: CorrectedBatch


class Sent(NamedTuple):
    """How many samples of a boot its device had sent at a time, monotonic s."""

    time_s: float
    samples: int


class Done(NamedTuple):
    """A fault, in words, from when to when, monotonic s; `costs`: whose samples it may cost, "" for those of all."""

    what: str
    begin_s: float
    end_s: float
    costs: str | None = None


@dataclass(slots=True)
class History:
    """Batches as the application got them, in order; statuses, calibrations and misses as they came."""

    heard: defaultdict[Boot, list[Heard]] = field(default_factory=partial(defaultdict, list))
    #: as they came over the bus, before anything was put in order
    said: list[Heard] = field(default_factory=list)
    sent: defaultdict[Boot, list[Sent]] = field(default_factory=partial(defaultdict, list))
    #: messages that were not understood, by reason
    refused: dict[str, int] = field(default_factory=dict)
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    statuses: dict[str, Status] = field(default_factory=dict)
    misses: list[Miss] = field(default_factory=list)
    events: set[tuple[str, str]] = field(default_factory=set)
    done: list[Done] = field(default_factory=list)
    end_s: float = 0.0
    #: when a status came last
    status_s: float = 0.0

    @property
    def samples(self) -> int:
        """How many corrected samples were heard."""
        return sum(len(heard.batch) for all_of in self.heard.values() for heard in all_of)

    @property
    def good(self) -> int:
        """How many of them were GOOD."""
        batches = (heard.batch for all_of in self.heard.values() for heard in all_of)
        return sum(len(batch) for batch in batches if batch.quality is Quality.GOOD)

    @property
    def calibrated(self) -> int:
        """How many devices have been calibrated."""
        return len({c.device for c in list(self.calibrations.values()) if c.verdict is Verdict.ACCEPTED})
