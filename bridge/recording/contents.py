"""Reads the decoded messages of recordings, validated as on the bus; several files, also torn ones, are read as one."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from bridge.recording.error import RecordingError, check_file
from bridge.recording.mcap_reader import Entry, McapReader
from bridge.recording.message_kinds import KINDS, PACKAGE, Said
from bridge.recording.per_sample import COPY
from bridge.recording.recording_file import ABOUT
from bridge.runtime.os_errors import why
from bridge.wire import keys
from bridge.wire.refusal import Refusal, Tally

Tell = Callable[[int, int], None]


class Heard(NamedTuple):
    """One message of a recording: its parsed key, its decoded content, and its log time, ns since the Unix epoch."""

    key: keys.Key
    said: Said
    log_ns: int


class Contents:
    """Iterates over the decoded messages (Heard) of a ward's recording files, earliest file first.

    wanted: kinds of message to decode, by the first word of their topic; empty means all. tell(done, total): progress,
    bytes. After iterating, `refused` counts the messages that could not be decoded, and `trouble` says what is wrong
    with each file. `size`: bytes of the files read. Raises RecordingError for a file that is not a recording of a ward.
    """

    def __init__(self, paths: Sequence[Path], wanted: Sequence[str] = (), tell: Tell = lambda _done, _of: None) -> None:
        for path in paths:
            check_file(path)
        self.refused = Tally()
        self.trouble: list[str] = []
        self.size = 0
        self._wanted = frozenset(wanted or KINDS)
        self._tell = tell
        self._paths = sorted(paths, key=_begin_ns) if len(paths) > 1 else list(paths)

    def __iter__(self) -> Iterator[Heard]:
        sizes = [path.stat().st_size for path in self._paths]
        for path, size in zip(self._paths, sizes, strict=True):
            for done, entry in _entries(path, self.trouble, self.refused):
                if (heard := self._heard(entry)) is not None:
                    yield heard
                self._tell(self.size + done, sum(sizes))
            self.size += size

    def _heard(self, entry: Entry) -> Heard | None:
        what = entry.topic.split("/", 1)[0]
        if what not in self._wanted:
            if what not in KINDS:
                self.refused.add("foreign_topic")
            return None
        text = entry.facts.get("key", "")
        try:
            key = keys.parse(text)
            return Heard(key, KINDS[what].decode(text, entry.payload), entry.log_ns)
        except Refusal as refusal:
            self.refused.add(refusal.reason)
            return None


def _entries(path: Path, trouble: list[str], refused: Tally) -> Iterator[tuple[int, Entry]]:
    """Yield the bytes read so far and an entry. Raises RecordingError if the file is not a recording of a ward."""
    try:
        with path.open("rb") as file:
            reader = McapReader(file, str(path))
            ours, foreign = False, ""
            for entry in reader.entries():
                if COPY in entry.facts:
                    continue
                if entry.schema.startswith(PACKAGE):
                    ours = True
                    yield reader.good, entry
                else:
                    refused.add("foreign_schema")
                    foreign = foreign or entry.topic or "a channel without a name"
            if not ours and foreign and ABOUT not in reader.facts:
                raise RecordingError(
                    f"{path}: not a recording by truerate: it holds {foreign!r}; give a file that `truerate record` wrote"
                )
            if not ours:
                raise RecordingError(f"{path}: the recording is empty: {'; '.join(reader.trouble) or 'no message'}")
            trouble += [f"{path}: {words}" for words in reader.trouble]
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {why(error)}") from None


def _begin_ns(path: Path) -> int:
    return next((entry.log_ns for _, entry in _entries(path, [], Tally())), 0)
