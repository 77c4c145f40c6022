"""What samples of a device led to."""

from dataclasses import dataclass, field

from bridge.wire.messages import BiasRevision, Calibration, CorrectedBatch
from estimator.device.window_summary import Second


@dataclass(slots=True)
class Outcome:
    """What samples, which may be of minutes, led to. `said` are things to log, most important last.

    corrected: the samples themselves, where that was done at once.
    """

    corrected: list[CorrectedBatch] = field(default_factory=list)
    calibrations: list[Calibration] = field(default_factory=list)
    revisions: list[BiasRevision] = field(default_factory=list)
    seconds: list[Second] = field(default_factory=list)
    changed: bool = False
    said: list[str] = field(default_factory=list)

    @property
    def worded(self) -> bool:
        """Whether anything but samples is to be published of it."""
        return self.changed or bool(self.calibrations) or bool(self.revisions)
