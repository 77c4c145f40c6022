"""Core of the recorder: messages in, files out. Time is an argument, and files come from a `Folder`; it has no bus.

If a file cannot be written (a full disk, a pulled stick), it is finished if possible, otherwise left as it is. A new
file is begun when there is room again, and messages lost meanwhile are counted. No file error ends the recorder.
"""

import errno
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from bridge.bus.contract import Message
from bridge.recording import message_kinds
from bridge.recording.files import Folder, recorded_in
from bridge.recording.mcap_writer import MAX_CHANNELS
from bridge.recording.message_kinds import KINDS, PRIVATE, Kind, Said
from bridge.recording.per_sample import Copy, PerSample
from bridge.recording.recording_file import MOST_OF_A_BRIDGE, Item, RecordingFile
from bridge.recording.retention import expired
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


class NoRoom(OSError):
    """The disk's free space is less than the part reserved for others, or less than a new file needs."""


@dataclass(frozen=True, slots=True)
class Knobs:
    """Settings of a recorder: when to begin a new file, how much disk to leave free, and when to delete old files.

    A new file begins after rotate_s seconds or rotate_bytes. flush_s: seconds between flushes; so much may be lost in a
    power failure. retry_s: seconds between attempts after an error.
    A file is begun only if room_bytes are free in addition to keep_free_bytes. Finished files are deleted, the oldest
    first, when they are older than keep_s seconds, or when all files together exceed keep_bytes.
    """

    rotate_s: float = 3600.0
    rotate_bytes: float = 500e6
    keep_free_bytes: float = 200e6
    room_bytes: float = 16e6
    flush_s: float = 0.4
    retry_s: float = 5.0
    keep_s: float = float("inf")
    keep_bytes: float = float("inf")


@dataclass(slots=True)
class Account:
    """Counts of recorded and lost messages, for progress and exit code.

    heard: when each device last sent samples, in seconds of `take`'s clock, by device id.
    raw, corrected: number of readings and of corrected samples. messages: number written.
    closed_bytes: size of the files closed. files: their paths.
    """

    heard: dict[str, float] = field(default_factory=dict)
    raw: int = 0
    corrected: int = 0
    messages: int = 0
    closed_bytes: int = 0
    files: list[Path] = field(default_factory=list)  # an unfinished file ends in PART
    refused: Tally = field(default_factory=Tally)
    not_recorded: int = 0  # messages that came while no file could be written, or were in its last chunk
    expired: int = 0  # finished recordings that were deleted
    trouble: str = ""  # why nothing can be written now; empty if all is well
    copy_fault: str = ""  # why finished files are not copied to the bucket; empty if they are


class WardRecorder:
    """Records the messages of one ward into MCAP files, without a bus or a clock of its own.

    Call `begin`, then `take` and `tick` repeatedly, then `close`, all from one thread.
    wall_ns is UTC in ns since the Unix epoch, now_s seconds of a monotonic clock. `account` has the counts.
    """

    def __init__(
        self,
        place: Folder,
        ward: str,
        devices: Iterable[str] = (),
        knobs: Knobs | None = None,
        *,
        per_sample: bool = False,
        copied: Callable[[Path], bool] = lambda _: True,
    ) -> None:
        """per_sample: also write each sample as one ROS 2 message. copied: whether a finished file is where it is copied to."""
        self.account, self._copied = Account(), copied
        self._place, self._ward, self._devices = place, ward, frozenset(devices)
        self._knobs = knobs or Knobs()
        self._per_sample = PerSample(ward) if per_sample else None
        self._file: RecordingFile | None = None
        self._latest: dict[str, Item] = {}
        self._began_s = self._flushed_s = self._retry_s = 0.0
        self._expire_s, self._undeletable = float("-inf"), set[Path]()

    def use(self, devices: Iterable[str], knobs: Knobs) -> None:
        """Use other settings from now on. devices: ids of the devices to record; all if empty."""
        self._devices, self._knobs = frozenset(devices), knobs

    @property
    def size(self) -> int:
        """Number of bytes written to all files, the open one included."""
        return self.account.closed_bytes + (self._file.writer.size if self._file else 0)

    def begin(self, wall_ns: int, now_s: float) -> None:
        """Begin a file, with the latest repeated messages first.

        Raises OSError if that is impossible, NoRoom on a full disk.
        """
        self._check_room(self._knobs.keep_free_bytes + self._knobs.room_bytes)
        self._file = RecordingFile(self._place.begin(wall_ns), self._ward)
        self._began_s = now_s
        self._flushed_s = now_s - self._knobs.flush_s  # the first tick then flushes the repeated messages
        self._latest = {key: item for key, item in self._latest.items() if self._put(item, wall_ns)}

    def take(self, messages: Iterable[Message], wall_ns: int, now_s: float) -> None:
        """Record messages from the bus; count those that are refused, or come while nothing can be written.

        A message about another device than the chosen ones is ignored.
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
                    if not self._put(item, wall_ns):
                        continue
                    if self._per_sample is not None:
                        self._put_copies(self._per_sample.take(said, now_s))
                except OSError as error:
                    self._stall(error, now_s)
            if isinstance(said, SampleBatch | CorrectedBatch):
                self._count(said, now_s)
            elif _repeated(kind, said) and (message.key in self._latest or len(self._latest) < MOST_REPEATED):
                self._latest[message.key] = item

    def tick(self, wall_ns: int, now_s: float) -> None:
        """Flush, begin a new file, retry after an error, or delete old files, as the time has come for each.

        Call it several times a second.
        """
        if now_s >= self._expire_s:
            self._expire_s = now_s + EXPIRE_S
            self._expire(wall_ns)
        if self._file is None:
            if now_s >= self._retry_s:
                self._try_again(wall_ns, now_s)
            return
        if (per_sample := self._per_sample) is not None:
            self._guarded(lambda: self._put_copies(per_sample.due(now_s)), now_s)
        if now_s - self._flushed_s >= self._knobs.flush_s:
            self._flushed_s = now_s
            self._guarded(self._flush, now_s)
            if self._is_long(now_s):
                self._guarded(lambda: self._rotate(wall_ns, now_s), now_s)

    def said(self, error: OSError) -> str:
        """Return a sentence on why nothing can be written."""
        return str(error) if isinstance(error, NoRoom) else self._place.said(error)

    def close(self) -> None:
        """Finish the file; its messages are flushed and it gets its final name.

        An error is logged, and counted in `account`.
        """
        if (per_sample := self._per_sample) is not None:
            self._guarded(lambda: self._put_copies(per_sample.due()), 0.0)
        self._guarded(self._finish, 0.0)

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
            if self._devices and key.device not in self._devices:
                return None
            return kind, kind.decode(message.key, message.payload)
        except Refusal as refusal:
            if self.account.refused.add(refusal.reason) == 1:
                _log.warning("a message is not recorded: %s (later ones of this kind are only counted)", refusal)
            return None

    def _count(self, batch: SampleBatch | CorrectedBatch, now_s: float) -> None:
        self.account.heard[batch.device] = now_s
        if isinstance(batch, SampleBatch):
            self.account.raw += len(batch)
        else:
            self.account.corrected += len(batch)

    # ---- the file -------------------------------------------------------------------------------------------------

    def _put(self, item: Item, wall_ns: int) -> bool:
        """Write a message; False if there are too many channels."""
        if self._file is None or self._file.put(item, message_kinds.log_ns(item.own_ns, wall_ns)):
            self.account.messages += self._file is not None
            return True
        self.account.not_recorded += 1
        if self.account.refused.add("too_many_channels") == 1:
            _log.error(
                "%s is not recorded: a file holds at most %d streams, %d per bridge (others are only counted)",
                item.key,
                MAX_CHANNELS,
                MOST_OF_A_BRIDGE,
            )
        return False

    def _put_copies(self, copies: Iterable[Copy]) -> None:
        for copy in copies:
            if self._file is not None:
                self._file.copies.put(copy)

    def _flush(self) -> None:
        if self._file is None:
            return
        self._file.writer.flush()
        self._file.output.sync()
        self._check_room(self._knobs.keep_free_bytes)

    def _check_room(self, wanted: float) -> None:
        free = self._place.free_bytes()
        if free < wanted:
            raise NoRoom(
                f"the disk is nearly full: {free / 1e6:.1f} MB are free, {wanted / 1e6:.1f} MB are needed (keep_free_mb "
                f"keeps {self._knobs.keep_free_bytes / 1e6:.0f} MB free)"
            )

    def _is_long(self, now_s: float) -> bool:
        if self._file is None:
            return False
        return now_s - self._began_s >= self._knobs.rotate_s or self._file.writer.size >= self._knobs.rotate_bytes

    def _expire(self, wall_ns: int) -> None:
        """Delete the recordings that have expired; each is logged and counted."""
        keep_s, keep_bytes = self._knobs.keep_s, self._knobs.keep_bytes
        if min(keep_s, keep_bytes) == float("inf"):
            return
        size = self._file.writer.size if self._file else 0
        for one, why in expired(self._place.finished(), size, wall_ns, keep_s, keep_bytes):
            lost = "" if self._copied(one.path) else ", before it was copied to the bucket"
            try:
                one.path.unlink()
            except OSError as error:
                if one.path not in self._undeletable:
                    self._undeletable.add(one.path)
                    _log.error("%s cannot be deleted, though %s says so: %s", one.path, why, why_of(error))
                continue
            self.account.expired += 1
            self.account.files = [path for path in self.account.files if path != one.path]
            _log.warning("%s (%.1f MB) is deleted, as %s says%s", one.path, one.bytes / 1e6, why, lost)

    def _rotate(self, wall_ns: int, now_s: float) -> None:
        self._finish()
        self.begin(wall_ns, now_s)

    def _finish(self) -> None:
        if self._file is None:
            return
        file = self._file
        file.writer.finish()
        file.output.finish()
        self._file = None
        self.account.closed_bytes += file.writer.size
        self.account.files.append(file.output.path)

    def _guarded(self, work: Callable[[], None], now_s: float) -> None:
        try:
            work()
        except OSError as error:
            self._stall(error, now_s)

    def _stall(self, error: OSError, now_s: float) -> None:
        """Close the file after an error, finished if possible, and schedule the next attempt."""
        account, file, self._file = self.account, self._file, None
        account.trouble = self.said(error)
        # A size limit or a removed file need not stop the next file.
        removed = isinstance(error, FileNotFoundError)
        again = removed or error.errno == errno.EFBIG
        at_once = again and file is not None and file.writer.messages
        self._retry_s = now_s if at_once else now_s + self._knobs.retry_s
        words = ""
        if file is not None:
            left = file.left(writable=isinstance(error, NoRoom))
            account.not_recorded += file.writer.pending
            account.closed_bytes += file.writer.size
            if left is not None and not removed:
                account.files.append(left)
                words = f" Earlier data is {recorded_in(left)}"
        _log.error("%s. Recording has stopped, and goes on as soon as possible.%s", account.trouble, words)

    def _try_again(self, wall_ns: int, now_s: float) -> None:
        try:
            self.begin(wall_ns, now_s)
        except OSError as error:
            self._retry_s = now_s + self._knobs.retry_s
            _log.debug("still: %s", self.said(error))
            return
        self.account.trouble = ""
        if self._file is not None:
            _log.warning(
                "recording again, into %s; %s lost meanwhile",
                self._file.output.path,
                count(self.account.not_recorded, "message"),
            )


def _repeated(kind: Kind, said: Said) -> bool:
    """Whether the next file begins with the message; not with a rejected calibration, as the one before stays in force."""
    return kind.repeated and not (isinstance(said, Calibration) and said.verdict is not Verdict.ACCEPTED)
