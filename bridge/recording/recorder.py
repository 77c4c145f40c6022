"""Core of the recorder, without a bus: messages in, files out. Time is an argument, and files come from a `Folder`.

If a file cannot be written (full disk, removed stick), the file is finished if possible. A new file is begun when there
is space again; messages lost in between are counted. No file error ends the recorder.
"""

import errno
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import inf
from pathlib import Path

from bridge.bus.contract import Message
from bridge.recording import message_kinds
from bridge.recording.files import Folder, recorded_in
from bridge.recording.mcap_writer import MAX_CHANNELS
from bridge.recording.message_kinds import KINDS, PRIVATE, Kind, Said
from bridge.recording.per_sample import PerSample, write_copies
from bridge.recording.recording_file import MOST_OF_A_BRIDGE, Item, RecordingFile
from bridge.recording.settings import Recorder
from bridge.runtime.os_errors import why as why_of
from bridge.terminal.plurals import count
from bridge.wire import keys
from bridge.wire.messages import Calibration, CorrectedBatch, SampleBatch, Verdict
from bridge.wire.refusal import Refusal, Tally

_log = logging.getLogger(__name__)


#: most repeated messages at the beginning of a file; as much room is left to new channels
MOST_REPEATED = MAX_CHANNELS // 2


#: interval between looks for recordings that have expired, s
EXPIRE_S = 60.0
#: seconds between flushes; so much may be lost in a power failure
FLUSH_S = 0.4
#: seconds between attempts after an error
RETRY_S = 5.0
#: bytes that must be free for a new file, in addition to those left free for others
ROOM_BYTES = 16e6


class NoRoom(OSError):
    """Too little free disk space: less than the reserve in the settings, or than a new file needs."""


@dataclass(slots=True)
class Account:
    """Counts of recorded and lost messages, for progress and exit code.

    heard: time at which each device last sent samples, by device id, s of a monotonic clock.
    raw, corrected: number of readings and of corrected samples. closed_bytes: size of the closed files. files: their
    paths.
    """

    heard: dict[str, float] = field(default_factory=dict)
    raw: int = 0
    corrected: int = 0
    closed_bytes: int = 0
    files: list[Path] = field(default_factory=list)  # an unfinished file ends in PART
    refused: Tally = field(default_factory=Tally)
    not_recorded: int = 0  # messages that came while no file could be written, or were in its last chunk
    expired: int = 0  # finished recordings that were deleted
    trouble: str = ""  # why nothing can be written now; empty if all is well


class WardRecorder:
    """Recorder of one ward's messages to MCAP files, without a bus or a clock of its own.

    Call `begin`, then `take` and `tick` repeatedly, then `close`, all from one thread. `account` counts recorded and
    lost messages. place: folder for the files. ward: id.
    copied(path): True if a finished file has its copy in object storage, or needs none. If False, the log says so when
    the file is deleted.
    """

    def __init__(
        self,
        place: Folder,
        ward: str,
        settings: Recorder,
        *,
        copied: Callable[[Path], bool] = lambda _: True,
    ) -> None:
        """copied: whether a finished file is where it is copied to."""
        self.account, self._copied = Account(), copied
        self._place, self._ward, self._settings = place, ward, settings
        self._per_sample = PerSample(ward) if settings.per_sample else None
        self._file: RecordingFile | None = None
        self._latest: dict[str, Item] = {}
        self._began_s = self._flushed_s = self._retry_s = 0.0
        self._expire_s, self._undeletable = -inf, set[Path]()

    def use(self, settings: Recorder) -> None:
        """Use other settings from now on; new values of `folder`, `wait_s` and `per_sample` are ignored."""
        self._settings = settings

    @property
    def size(self) -> int:
        """Number of bytes written to all files, the open one included."""
        return self.account.closed_bytes + (self._file.writer.size if self._file else 0)

    def begin(self, wall_ns: int, now_s: float) -> None:
        """Begin a new file, which starts with the latest info, status and calibration of each device.

        wall_ns: UTC, ns since the Unix epoch. now_s: monotonic time, s.
        Raises OSError if the file cannot be made; this is NoRoom on a full disk.
        """
        self._check_room(ROOM_BYTES)
        file = self._file = RecordingFile(self._place.begin(wall_ns), self._ward)
        self._began_s = now_s
        self._flushed_s = now_s - FLUSH_S  # the first tick then flushes the repeated messages
        self._latest = {key: item for key, item in self._latest.items() if self._put(file, item, wall_ns)}

    def take(self, messages: Iterable[Message], wall_ns: int, now_s: float) -> None:
        """Record messages from the bus; count invalid messages, and those that arrive while no file can be written.

        Messages about devices that the settings do not name are ignored.
        wall_ns: UTC, ns since the Unix epoch. now_s: monotonic time, s.
        """
        for message in messages:
            if (understood := self._understood(message)) is None:
                continue
            kind, said = understood
            item = Item(message.key, kind, kind.time_ns(said), message.payload)
            if self._file is None:
                self.account.not_recorded += 1
            else:
                try:
                    if not self._put(self._file, item, wall_ns):
                        continue
                    if self._per_sample is not None:
                        write_copies(self._file.writer, self._per_sample.take(said, now_s))
                except OSError as error:
                    self._stall(error, now_s)
            if isinstance(said, SampleBatch | CorrectedBatch):
                self._count(said, now_s)
            elif _repeated(kind, said) and (message.key in self._latest or len(self._latest) < MOST_REPEATED):
                self._latest[message.key] = item

    def tick(self, wall_ns: int, now_s: float) -> None:
        """Do the work that is due: flush, begin a new file, retry after an error, delete old files.

        Call several times a second. wall_ns: UTC, ns since the Unix epoch. now_s: monotonic time, s.
        """
        if now_s >= self._expire_s:
            self._expire_s = now_s + EXPIRE_S
            self._expire(wall_ns)
        file = self._file
        if file is None:
            if now_s >= self._retry_s:
                self._try_again(wall_ns, now_s)
            return
        try:
            if self._per_sample is not None:
                write_copies(file.writer, self._per_sample.due(now_s))
            if now_s - self._flushed_s >= FLUSH_S:
                self._flushed_s = now_s
                file.writer.flush()
                file.output.sync()
                self._check_room(0.0)
                lasted_s, size_mb = now_s - self._began_s, file.writer.size / 1e6
                if lasted_s >= self._settings.rotate_s or size_mb >= self._settings.rotate_mb:
                    self._finish(file)
                    self.begin(wall_ns, now_s)
        except OSError as error:
            self._stall(error, now_s)

    def said(self, error: OSError) -> str:
        """Return a sentence on why no file can be written. error: raised by the write."""
        return str(error) if isinstance(error, NoRoom) else self._place.said(error)

    def close(self) -> None:
        """Flush and finish the file, and rename it to its final name.

        An error is logged, and its lost messages are counted in `account`.
        """
        if (file := self._file) is None:
            return
        try:
            if self._per_sample is not None:
                write_copies(file.writer, self._per_sample.due())
            self._finish(file)
        except OSError as error:
            self._stall(error, 0.0)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def _understood(self, message: Message) -> tuple[Kind, Said] | None:
        try:
            key = keys.parse(message.key)
            if key.what in PRIVATE:
                return None
            kind = KINDS.get(key.what)
            if kind is None:
                self.account.refused.add(f"kind_{key.what}")
                return None
            if self._settings.devices and key.device not in self._settings.devices:
                return None
            return kind, kind.decode(message.key, message.payload)
        except Refusal as refusal:
            if self.account.refused.add(refusal.reason) == 1:
                _log.warning("a message is not recorded: %s (later ones of this kind are counted, not logged)", refusal)
            return None

    def _count(self, batch: SampleBatch | CorrectedBatch, now_s: float) -> None:
        self.account.heard[batch.device] = now_s
        if isinstance(batch, SampleBatch):
            self.account.raw += len(batch)
        else:
            self.account.corrected += len(batch)

    # ---- the file -------------------------------------------------------------------------------------------------

    def _put(self, file: RecordingFile, item: Item, wall_ns: int) -> bool:
        """Write a message; False if there are too many channels."""
        if file.put(item, message_kinds.log_ns(item.own_ns, wall_ns)):
            return True
        self.account.not_recorded += 1
        if self.account.refused.add("too_many_channels") == 1:
            _log.error(
                "%s is not recorded: a file holds at most %d streams, %d per bridge (other streams are counted, not logged)",
                item.key,
                MAX_CHANNELS,
                MOST_OF_A_BRIDGE,
            )
        return False

    def _check_room(self, more_bytes: float) -> None:
        free_mb, kept_mb = self._place.free_bytes() / 1e6, self._settings.keep_free_mb
        wanted_mb = kept_mb + more_bytes / 1e6
        if free_mb < wanted_mb:
            raise NoRoom(
                f"the disk is nearly full: {free_mb:.1f} MB are free, {wanted_mb:.1f} MB are needed (keep_free_mb "
                f"keeps {kept_mb:.0f} MB free)"
            )

    def _expire(self, wall_ns: int) -> None:
        """Delete the recordings that have expired; each is logged and counted."""
        settings = self._settings
        if not settings.keep_days and not settings.keep_gb:
            return
        most_s, most_bytes = settings.keep_days * 86_400 or inf, settings.keep_gb * 1e9 or inf
        for one, why in self._place.expired(self.size - self.account.closed_bytes, wall_ns, most_s, most_bytes):
            lost = "" if self._copied(one.path) else ", before it was copied to the bucket"
            try:
                one.path.unlink()
            except OSError as error:
                if one.path not in self._undeletable:
                    self._undeletable.add(one.path)
                    _log.error(
                        "%s must be deleted because of %s, but cannot be deleted: %s", one.path, why, why_of(error)
                    )
                continue
            self.account.expired += 1
            self.account.files = [path for path in self.account.files if path != one.path]
            _log.warning("%s (%.1f MB) is deleted because of %s%s", one.path, one.bytes / 1e6, why, lost)

    def _finish(self, file: RecordingFile) -> None:
        file.writer.finish()
        file.output.finish()
        self._file = None
        self.account.closed_bytes += file.writer.size
        self.account.files.append(file.output.path)

    def _stall(self, error: OSError, now_s: float) -> None:
        """Close the file after an error, finished if possible, and schedule the next attempt."""
        account, file, self._file = self.account, self._file, None
        account.trouble = self.said(error)
        # A size limit or a removed file need not stop the next file.
        removed = isinstance(error, FileNotFoundError)
        at_once = (removed or error.errno == errno.EFBIG) and file is not None and file.writer.messages
        self._retry_s = now_s if at_once else now_s + RETRY_S
        words = ""
        if file is not None:
            left = file.left(writable=isinstance(error, NoRoom))
            account.not_recorded += file.writer.pending
            account.closed_bytes += file.writer.size
            if left is not None and not removed:
                account.files.append(left)
                words = f" Earlier data is {recorded_in(left)}"
        _log.error("%s. Recording has stopped, and resumes as soon as possible.%s", account.trouble, words)

    def _try_again(self, wall_ns: int, now_s: float) -> None:
        try:
            self.begin(wall_ns, now_s)
        except OSError as error:
            self._retry_s = now_s + RETRY_S
            _log.debug("recording is still stopped: %s", self.said(error))
            return
        self.account.trouble = ""
        if self._file is not None:
            _log.warning(
                "recording again, into %s; %s lost meanwhile",
                self._file.output.path,
                count(self.account.not_recorded, "message"),
            )


def _repeated(kind: Kind, said: Said) -> bool:
    """Return whether the next file begins with the message; not with a rejected calibration, as the one before stays in force."""
    return kind.repeated and not (isinstance(said, Calibration) and said.verdict is not Verdict.ACCEPTED)
