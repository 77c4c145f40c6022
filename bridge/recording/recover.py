"""Recovery of unfinished or damaged recordings: copies every readable message to a new file, and reports the losses."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import BinaryIO

from bridge.recording.error import RecordingError, check_file
from bridge.recording.files import PART, in_use, new_file
from bridge.recording.mcap_reader import Entry, McapReader
from bridge.recording.mcap_writer import PROTOBUF, ROS2, McapWriter
from bridge.recording.message_kinds import KINDS, PACKAGE, Said
from bridge.recording.per_sample import COPY, PerSample, write_copies
from bridge.recording.recording_file import ABOUT
from bridge.runtime.os_errors import why
from bridge.terminal.plurals import count
from bridge.wire import keys
from bridge.wire.refusal import Refusal

Tell = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Recovered:
    """Result of a recovery.

    out: the new file. messages: number of messages copied. first_ns, last_ns: their first and last log time, ns since
    the Unix epoch. trouble: faults of the original file, as sentences for the user.
    """

    out: Path
    messages: int
    first_ns: int
    last_ns: int
    trouble: tuple[str, ...]

    def said(self) -> list[str]:
        """Return the result of the recovery as lines for the user."""
        kept = f"{count(self.messages, 'message')}, from {_clock(self.first_ns)} to {_clock(self.last_ns)}"
        return [f"{self.out}: {kept}", *self.trouble]


def recover(path: Path, out: Path | None = None, tell: Tell = lambda _done, _of: None) -> Recovered:
    """Copy every readable message of an unfinished or damaged recording to a new, complete file; the original is kept.

    out: the new file; by default the name without .part, or NAME.recovered.mcap. tell(done, total): called with the
    number of bytes read so far, and of all bytes.
    Raises RecordingError if the file cannot be read, has no readable message, is still being recorded, or is complete.
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
    """Copy a ward's recording to `out`, and add each of its samples as one ROS 2 message.

    device: copy only messages about this device; empty for all. tell(done, total): called with the number of bytes
    read so far, and of all bytes.
    Raises RecordingError if the recording cannot be read, or `out` exists or cannot be written.
    """
    check_file(path)
    try:
        with path.open("rb") as file, new_file(out) as copy:
            reader = McapReader(file, str(path))
            return _copied(reader, copy, path, out, tell, per_sample=True, device=device)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None


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
    foreign = Counter[str]()
    entries = _ours(reader, foreign, device, per_sample=per_sample)
    if (first := next(entries, None)) is None:
        raise RecordingError(f"{path}: {_why_nothing(reader, foreign, device)}")
    about = reader.facts.get(ABOUT, {})
    writer = McapWriter(copy, ABOUT, about)
    samples = PerSample(about.get("ward", ""))
    first_ns = last_ns = first.log_ns
    for entry in chain([first], entries):
        encoding = ROS2 if COPY in entry.facts else PROTOBUF
        definition = reader.descriptors[entry.schema]
        channel = writer.channel(entry.topic, entry.schema, definition, entry.facts, encoding=encoding)
        writer.add(channel, entry.log_ns, entry.publish_ns, entry.payload)
        if per_sample and (said := _said(entry)) is not None:
            write_copies(writer, samples.take(said, entry.log_ns * 1e-9))
        first_ns, last_ns = min(first_ns, entry.log_ns), max(last_ns, entry.log_ns)
        tell(reader.good, reader.size)
    write_copies(writer, samples.due())
    writer.finish()
    others = [f"{count(n, 'message')} of {schema or 'no schema'!r} skipped" for schema, n in foreign.items()]
    return Recovered(target, writer.messages, first_ns, last_ns, (*reader.trouble, *others))


def _ours(reader: McapReader, foreign: Counter[str], device: str, *, per_sample: bool) -> Iterator[Entry]:
    """Yield the messages to copy, and count by schema those of other programs. per_sample: leave out older copies."""
    for entry in reader.entries():
        is_copy = COPY in entry.facts
        if (is_copy and per_sample) or (device and entry.facts.get("device") != device):
            continue
        if is_copy or entry.schema.startswith(PACKAGE):
            yield entry
        else:
            foreign[entry.schema] += 1


def _why_nothing(reader: McapReader, foreign: Counter[str], device: str) -> str:
    if foreign:
        return f"not a recording by truerate: it holds {next(iter(foreign)) or 'no schema'!r} messages"
    if device:
        return f"nothing of --device {device!r}; `truerate recording info` shows what the file holds"
    return f"nothing can be recovered: {'; '.join(reader.trouble) or 'the file holds no message'}"


def _said(entry: Entry) -> Said | None:
    """Return the decoded message of an entry; None for an invalid one."""
    key = entry.facts.get("key", "")
    try:
        return KINDS[keys.parse(key).what].decode(key, entry.payload)
    except (Refusal, KeyError):
        return None


def _name(path: Path) -> Path:
    if path.name.endswith(PART):
        return path.with_name(path.name.removesuffix(PART))
    return path.with_name(f"{path.stem}.recovered.mcap")


def _clock(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M:%S.%f}"[:-3] + " UTC"
