"""Results of processing a device's samples: messages to publish and lines to log."""

from dataclasses import dataclass, field

from bridge.wire.messages import BiasRevision, Calibration
from estimator.device.window_summary import Second


@dataclass(slots=True)
class Outcome:
    """Results of processing samples of one device; they may cover minutes of samples.

    calibrations, revisions: messages to publish. seconds: finished blocks of samples, each half a second or a second
    long, for window summaries.
    changed: whether the device's status changed and must be published. said: lines to log, most important last.
    """

    calibrations: list[Calibration] = field(default_factory=list)
    revisions: list[BiasRevision] = field(default_factory=list)
    seconds: list[Second] = field(default_factory=list)
    changed: bool = False
    said: list[str] = field(default_factory=list)

    @property
    def worded(self) -> bool:
        """True if there is a message to publish other than samples: a status, calibration or revision."""
        return self.changed or bool(self.calibrations) or bool(self.revisions)
