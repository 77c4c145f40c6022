"""Reader of the decoded messages of recordings, validated as on the bus; accepts several files, also damaged ones."""

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
    """Message of a recording: its parsed bus key and its decoded content."""

    key: keys.Key
    said: Said


def contents(
    paths: Sequence[Path], wanted: Sequence[str], tell: Tell, refused: Tally, trouble: list[str]
) -> Iterator[Heard]:
    """Yield the decoded messages of a ward's recording files, earliest file first.

    wanted: kinds of message to decode, by the first word of their topic; empty for all. tell(done, total): called with
    the number of bytes read so far, and of all bytes. refused: counts messages that could not be decoded.
    trouble: a sentence is added for each fault of a file.
    Raises RecordingError for a file that is not a recording of a ward.
    """
    for path in paths:
        check_file(path)
    sizes = {path: path.stat().st_size for path in paths}  # a recorder may give a file its final name meanwhile
    done, total = 0, sum(sizes.values())
    for path in sorted(paths, key=_begin_ns) if len(paths) > 1 else paths:
        for read, entry in _entries(path, trouble, refused):
            if (heard := _heard(entry, wanted or tuple(KINDS), refused)) is not None:
                yield heard
            tell(done + read, total)
        done += sizes[path]


def _heard(entry: Entry, wanted: Sequence[str], refused: Tally) -> Heard | None:
    what = entry.topic.split("/", 1)[0]
    if what not in wanted:
        if what not in KINDS:
            refused.add("foreign_topic")
        return None
    text = entry.facts.get("key", "")
    try:
        return Heard(keys.parse(text), KINDS[what].decode(text, entry.payload))
    except Refusal as refusal:
        refused.add(refusal.reason)
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
