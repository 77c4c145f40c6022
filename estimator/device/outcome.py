"""Results of processing a device's samples."""

from dataclasses import dataclass, field

from bridge.wire.messages import BiasRevision, Calibration, CorrectedBatch
from estimator.device.orientation import OrientedCut
from estimator.device.window_summary import Second


@dataclass(slots=True)
class Outcome:
    """Results of processing a device's samples, possibly of minutes.

    corrected: corrected batches, where samples were corrected at once. oriented: their attitudes, if estimated.
    calibrations, revisions: messages to publish. seconds: finished blocks, for window summaries.
    changed: the device's status changed and must be published. said: lines to log, most important last.
    """

    corrected: list[CorrectedBatch] = field(default_factory=list)
    oriented: list[OrientedCut] = field(default_factory=list)
    calibrations: list[Calibration] = field(default_factory=list)
    revisions: list[BiasRevision] = field(default_factory=list)
    seconds: list[Second] = field(default_factory=list)
    changed: bool = False
    said: list[str] = field(default_factory=list)

    @property
    def worded(self) -> bool:
        """True if there is a message to publish beside the samples: a status, calibration or revision."""
        return self.changed or bool(self.calibrations) or bool(self.revisions)
