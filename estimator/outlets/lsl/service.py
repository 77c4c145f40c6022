"""Copier of a ward's messages to LSL: batches to their device's streams; people's notes and calibrations as markers."""

import threading
import time
from collections.abc import Callable, Collection, Sequence

import numpy as np
import pylsl
from numpy.typing import NDArray

from bridge.reasons.catalogue import english
from bridge.runtime.open_files import make_room
from bridge.transport import host_time
from bridge.wire.messages import Calibration, CorrectedBatch, DeviceInfo, Note, Status
from estimator.client import Client, Miss
from estimator.outlets.lsl.streams import Batch, DeviceStream, MarkerStream
from estimator.outlets.places import Places

#: seconds between looks at messages that are no samples
_LOOK_S = 0.5
#: most streams, and open files of each; it also takes two threads. And files that are needed otherwise
_STREAMS, _FILES, _OTHER_FILES = 256, 9, 100


class LslClock:
    """Conversion from host time (ns since the Unix epoch) to LSL's clock (s).

    local_clock: returns the present time of LSL's clock, s.
    The host's clock may be set while the program runs. Sample times follow the host's clock; LSL's clock does not.
    """

    def __init__(self, local_clock: Callable[[], float]) -> None:
        # A delay between the two readings lowers the result, so the highest is the best.
        self._ahead_ns = max(host_time.now_ns() - round(local_clock() * 1e9) for _ in range(10))
        self._set_ns = host_time.set_ns()

    def follow(self) -> None:
        """Measure by how much the host's clock has been set since the start; later conversions allow for it."""
        self._set_ns = host_time.set_ns(self._set_ns)

    def stamp(self, time_ns: int) -> float:
        """Convert a host time, ns since the Unix epoch, to LSL time, s."""
        return (time_ns - self._set_ns - self._ahead_ns) * 1e-9

    def stamps(self, times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Convert host times (n,), ns since the Unix epoch, to LSL times (n,), s."""
        return np.asarray((times_ns - (self._set_ns + self._ahead_ns)) * 1e-9, np.float64)


class LslOutlet:
    """LSL streams of a ward: corrected rates of each device, the other requested kinds, and one stream of markers.

    devices: ids, None for all. kinds: further streams: orientation, quality, raw.
    A device's streams begin once its info and status are known, which provide the metadata.
    """

    def __init__(self, client: Client, devices: Sequence[str] | None, kinds: Collection[str]) -> None:
        self._ward, self._quality = client.ward, "quality" in kinds
        self._boots = Boots()
        streams = (make_room(_STREAMS * _FILES + _OTHER_FILES) - _OTHER_FILES) // _FILES
        self._places = Places(self._leave, streams // (1 + len(kinds)))
        self._clock = LslClock(pylsl.local_clock)
        self._began_ns = time.time_ns()
        self._corrected = client.corrected(devices, on_miss=self._boots.missed)
        self._orientation = client.orientation(devices) if "orientation" in kinds else None
        self._raw = client.raw(devices) if "raw" in kinds else None
        self._heard_infos, self._heard_statuses = client.follow_infos(devices), client.follow(devices)
        self._notes, self._calibrations = client.follow_notes(devices), client.follow_calibrations(devices)
        self._infos: dict[str, DeviceInfo] = {}
        self._statuses: dict[str, Status] = {}
        self._streams: dict[tuple[str, str], DeviceStream] = {}
        self._told: set[str] = set()  # ids of calibrations
        self._markers = MarkerStream(client.ward)

    def run(self, stop: threading.Event) -> None:
        """Copy messages from the bus to LSL until `stop` is set."""
        looked_s = 0.0
        while not stop.is_set():
            if time.monotonic() - looked_s >= _LOOK_S:
                looked_s = time.monotonic()
                self._look()
            for batch in filter(self._has_place, self._corrected.drain(0.1)):
                for words in self._boots.before(batch):
                    self._markers.push(words, self._clock.stamp(batch.start_time_ns))
                self._push("rates", batch)
                if self._quality:
                    self._push("quality", batch)
            if self._orientation is not None:
                for attitudes in self._orientation.drain():
                    self._push("orientation", attitudes)
            if self._raw is not None:
                for readings in self._raw.drain():
                    self._push("raw", readings)

    def _look(self) -> None:
        """Take infos and statuses, and send markers of notes and calibrations; past ones are left out."""
        self._clock.follow()
        for status in filter(self._has_place, self._heard_statuses.drain()):
            self._statuses[status.device] = status
        for info in self._heard_infos.drain():
            if info.boot and info.device in self._statuses and self._statuses[info.device].bridge in ("", info.bridge):
                self._infos[info.device] = info
        for note in self._notes.drain():
            if note.time_ns >= self._began_ns:
                self._markers.push(of_note(note), self._clock.stamp(note.time_ns))
        for calibration in self._calibrations.drain():
            # An estimator that takes a device over publishes its calibration again.
            if calibration.time_ns >= self._began_ns and calibration.id not in self._told:
                self._told.add(calibration.id)
                self._markers.push(of_calibration(calibration), self._clock.stamp(calibration.time_ns))

    def _has_place(self, message: CorrectedBatch | Status) -> bool:
        return self._places.take(message.device, time.monotonic())

    def _leave(self, device: str) -> None:
        self._boots.leave(device)
        self._infos.pop(device, None)
        self._statuses.pop(device, None)
        for key in [key for key in self._streams if key[0] == device]:
            del self._streams[key]

    def _push(self, kind: str, batch: Batch) -> None:
        stream = self._streams.get((batch.device, kind))
        if stream is None:
            info, status = self._infos.get(batch.device), self._statuses.get(batch.device)
            if info is None or status is None:
                return  # the stream does not exist yet, so nobody can read it
            stream = self._streams[batch.device, kind] = DeviceStream(self._ward, kind, info, status)
        stream.push(batch, self._clock.stamps(batch.sample_time_ns))


class Boots:
    """Finder of reboots and missing samples in the batches of devices; `before` returns them as LSL markers.

    For each gap, call `missed` first, and then `before` with the batch after the gap.
    """

    def __init__(self) -> None:
        self._boots: dict[str, int] = {}
        self._missing: dict[str, int] = {}

    def missed(self, miss: Miss) -> None:
        """Add to the number of samples that did not arrive, which `before` reports with the device's next batch.

        miss: the gap in the stream.
        """
        self._missing[miss.device] = self._missing.get(miss.device, 0) + miss.count

    def before(self, batch: CorrectedBatch) -> list[str]:
        """Return the markers to send at a batch's first sample: a reboot, the number of missing samples; often none."""
        missing = self._missing.pop(batch.device, 0)
        known = self._boots.get(batch.device)
        self._boots[batch.device] = batch.boot
        found = [f"{batch.device} reboot {batch.boot:016x}"] if known not in (None, batch.boot) else []
        return [*found, f"{batch.device} missing {missing}"] if missing else found

    def leave(self, device: str) -> None:
        """Forget the boot and the missing samples of a device."""
        self._boots.pop(device, None)
        self._missing.pop(device, None)


def of_calibration(calibration: Calibration) -> str:
    """Return the marker of a calibration, accepted or rejected: `<device> calibration <verdict> <reason>`."""
    return f"{calibration.device} calibration {calibration.verdict.name.lower()} {english(*calibration.reason)}".strip()


def of_note(note: Note) -> str:
    """Return the marker of a person's note: `<device> note <who>: <text>`."""
    return f"{note.device} note {note.who}: {note.text}"
