"""Recovers a torn or damaged recording: copies every readable message to a new file, and reports the losses."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from bridge.recording.error import RecordingError, check_file
from bridge.recording.files import PART, in_use, new_file
from bridge.recording.mcap_reader import McapReader
from bridge.recording.mcap_writer import McapWriter
from bridge.recording.message_kinds import PACKAGE
from bridge.recording.recording_file import ABOUT
from bridge.runtime.os_errors import why
from bridge.terminal.plurals import count

Tell = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Recovered:
    """Result of a recovery: messages from first_ns to last_ns (log time), and what is wrong with the original."""

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
    """Write a whole file beside the torn one, which is kept.

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


def _copied(reader: McapReader, copy: BinaryIO, path: Path, target: Path, tell: Tell) -> Recovered:
    writer: McapWriter | None = None
    channels: dict[tuple[str, str], int] = {}
    first_ns = last_ns = 0
    foreign = Counter[str]()
    for entry in reader.entries():
        if not entry.schema.startswith(PACKAGE):
            foreign[entry.schema] += 1
            continue
        if writer is None:
            writer = McapWriter(copy, ABOUT, reader.facts.get(ABOUT, {}))
        which = entry.topic, entry.schema
        if which not in channels:
            channels[which] = writer.channel(*which, reader.descriptors[entry.schema], entry.facts)
        writer.add(channels[which], entry.log_ns, entry.publish_ns, entry.payload)
        first_ns, last_ns = min(first_ns or entry.log_ns, entry.log_ns), max(last_ns, entry.log_ns)
        tell(reader.good, reader.size)
    if writer is None and foreign:
        raise RecordingError(
            f"{path}: not a recording by truerate: it holds {next(iter(foreign)) or 'no schema'!r} messages"
        )
    if writer is None:
        raise RecordingError(
            f"{path}: nothing can be recovered: {'; '.join(reader.trouble) or 'the file holds no message'}"
        )
    writer.finish()
    others = [f"{count(n, 'message')} of {schema or 'no schema'!r} skipped" for schema, n in foreign.items()]
    return Recovered(target, writer.messages, first_ns, last_ns, (*reader.trouble, *others))


def _name(path: Path) -> Path:
    if path.name.endswith(PART):
        return path.with_name(path.name.removesuffix(PART))
    return path.with_name(f"{path.stem}.recovered.mcap")


def _clock(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M:%S.%f}"[:-3] + " UTC"
