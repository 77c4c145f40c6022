"""Recovers a torn or damaged recording: copies every readable message to a new file, and reports the losses."""

import contextlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from bridge.recording.error import RecordingError, check_file
from bridge.recording.files import PART, in_use, new_file
from bridge.recording.mcap_reader import Entry, McapReader
from bridge.recording.mcap_writer import PROTOBUF, ROS2, McapWriter
from bridge.recording.message_kinds import KINDS, PACKAGE
from bridge.recording.per_sample import COPY, CopyChannels, PerSample
from bridge.recording.recording_file import ABOUT
from bridge.runtime.os_errors import why
from bridge.terminal.plurals import count
from bridge.wire import keys
from bridge.wire.refusal import Refusal

Tell = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Recovered:
    """Result of a recovery.

    out: the new file. messages: number copied. first_ns, last_ns: their log times, ns since the Unix epoch.
    trouble: what is wrong with the original, for the user.
    """

    out: Path
    messages: int
    first_ns: int
    last_ns: int
    trouble: tuple[str, ...]

    def said(self) -> list[str]:
        """Return the result as lines for the user."""
        kept = f"{count(self.messages, 'message')}, from {_clock(self.first_ns)} to {_clock(self.last_ns)}"
        return [f"{self.out}: {kept}", *self.trouble]


def recover(path: Path, out: Path | None = None, tell: Tell = lambda _done, _of: None) -> Recovered:
    """Copy every readable message of a torn or damaged recording to a new, whole file; the original is kept.

    out: the new file; default: the name without .part, or NAME.recovered.mcap. tell(done, total): progress in bytes.
    Raises RecordingError, also if the file is whole already.
    """
    check_file(path)
    target = out or _name(path)
    try:
        if in_use(path):
            raise RecordingError(f"{path}: still being recorded: wait until the recorder ends, or stop it")
        with path.open("rb") as file:
            reader = McapReader(file, str(path))
            with new_file(target) as copy:
                done = _copied(reader, copy, path, target, tell)
                if reader.whole and not path.name.endswith(PART):
                    raise RecordingError(f"{path}: the recording is complete: nothing to recover")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None
    return done


def add_per_sample(path: Path, out: Path, device: str = "", tell: Tell = lambda _done, _of: None) -> Recovered:
    """Copy a ward's recording to `out`, and write each of its samples also as one ROS 2 message.

    device: copy only what is about this device; empty for all. tell(done, total): progress in bytes. Raises
    RecordingError.
    """
    check_file(path)
    try:
        with path.open("rb") as file, new_file(out) as copy:
            reader = McapReader(file, str(path))
            return _copied(reader, copy, path, out, tell, per_sample=True, device=device)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None


class _SampleCopies:
    """Writes the copies of the samples of entries."""

    def __init__(self, writer: McapWriter, ward: str) -> None:
        self._per_sample, self._channels = PerSample(ward), CopyChannels(writer)

    def take(self, entry: Entry) -> None:
        """Write the copies that are ready after an entry; an invalid message has none."""
        key = entry.facts.get("key", "")
        with contextlib.suppress(Refusal, KeyError):
            said = KINDS[keys.parse(key).what].decode(key, entry.payload)
            for copy in self._per_sample.take(said, entry.log_ns * 1e-9):
                self._channels.put(copy)

    def finish(self) -> None:
        """Write the copies that still wait for further messages."""
        for copy in self._per_sample.due():
            self._channels.put(copy)


def _copied(
    reader: McapReader,
    copy: BinaryIO,
    path: Path,
    target: Path,
    tell: Tell,
    *,
    per_sample: bool = False,
    device: str = "",
) -> Recovered:
    writer: McapWriter | None = None
    samples: _SampleCopies | None = None
    channels: dict[tuple[str, str], int] = {}
    first_ns = last_ns = 0
    foreign = Counter[str]()
    for entry in reader.entries():
        is_copy = COPY in entry.facts
        if (is_copy and per_sample) or (device and entry.facts.get("device") != device):
            continue
        if not entry.schema.startswith(PACKAGE) and not is_copy:
            foreign[entry.schema] += 1
            continue
        if writer is None:
            about = reader.facts.get(ABOUT, {})
            writer = McapWriter(copy, ABOUT, about)
            samples = _SampleCopies(writer, about.get("ward", "")) if per_sample else None
        which = entry.topic, entry.schema
        if which not in channels:
            encoding = ROS2 if is_copy else PROTOBUF
            definition = reader.descriptors[entry.schema]
            channels[which] = writer.channel(*which, definition, entry.facts, encoding=encoding)
        writer.add(channels[which], entry.log_ns, entry.publish_ns, entry.payload)
        if samples is not None:
            samples.take(entry)
        first_ns, last_ns = min(first_ns or entry.log_ns, entry.log_ns), max(last_ns, entry.log_ns)
        tell(reader.good, reader.size)
    if writer is None and foreign:
        raise RecordingError(
            f"{path}: not a recording by truerate: it holds {next(iter(foreign)) or 'no schema'!r} messages"
        )
    if writer is None and device:
        raise RecordingError(
            f"{path}: nothing of --device {device!r}; `truerate recording info` shows what the file holds"
        )
    if writer is None:
        raise RecordingError(
            f"{path}: nothing can be recovered: {'; '.join(reader.trouble) or 'the file holds no message'}"
        )
    if samples is not None:
        samples.finish()
    writer.finish()
    others = [f"{count(n, 'message')} of {schema or 'no schema'!r} skipped" for schema, n in foreign.items()]
    return Recovered(target, writer.messages, first_ns, last_ns, (*reader.trouble, *others))


def _name(path: Path) -> Path:
    if path.name.endswith(PART):
        return path.with_name(path.name.removesuffix(PART))
    return path.with_name(f"{path.stem}.recovered.mcap")


def _clock(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M:%S.%f}"[:-3] + " UTC"
