"""Markers: what happens to a device, in one line `<device> <event> <details>`, each with its time. Pure."""

from bridge.reasons.catalogue import english
from bridge.wire.messages import Calibration, CorrectedBatch, Note
from estimator.client import Miss


class Boots:
    """Makes the markers that come from a device's batches: reboots and missing samples.

    Call `missed` before `before` is called with the batch after the hole.
    """

    def __init__(self) -> None:
        self._boots: dict[str, int] = {}
        self._missing: dict[str, int] = {}

    def missed(self, miss: Miss) -> None:
        """Count samples that did not arrive, until the next batch of their device. miss: the hole in the stream."""
        self._missing[miss.device] = self._missing.get(miss.device, 0) + miss.count

    def before(self, batch: CorrectedBatch) -> list[str]:
        """Return the markers to send at a batch's first sample, often none: a reboot, the number of missing samples."""
        missing = self._missing.pop(batch.device, 0)
        known = self._boots.get(batch.device)
        self._boots[batch.device] = batch.boot
        found = [f"{batch.device} reboot {batch.boot:016x}"] if known not in (None, batch.boot) else []
        return [*found, f"{batch.device} missing {missing}"] if missing else found

    def leave(self, device: str) -> None:
        """Forget boot and missing samples of a device."""
        self._boots.pop(device, None)
        self._missing.pop(device, None)


def of_calibration(calibration: Calibration) -> str:
    """Return the marker of a calibration, accepted or rejected: `<device> calibration <verdict> <reason>`."""
    return f"{calibration.device} calibration {calibration.verdict.name.lower()} {english(*calibration.reason)}".strip()


def of_note(note: Note) -> str:
    """Return the marker of a person's note: `<device> note <who>: <text>`."""
    return f"{note.device} note {note.who}: {note.text}"
