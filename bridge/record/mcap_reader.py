"""MCAP in, from any binary file, however it ended: what is whole is read, what is not is told.

The readers of the `mcap` package give up at the first byte they do not understand, some before the first message. Here
each record is framed by its length, and stands or falls by itself; its content is read by the package. A chunk whose
checksum does not hold is passed over.
"""

import contextlib
import struct
from collections.abc import Iterator
from io import SEEK_END, BytesIO
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema, Statistics
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

from bridge.recording_error import RecordingError
from bridge.wording import count

#: the most a chunk may unpack to
MAX_UNPACKED = 1 << 28
_HEAD = struct.Struct("<BQ")
_SPAN = struct.Struct("<QQ")


class Entry(NamedTuple):
    """One message as it was written."""

    topic: str
    schema: str
    facts: dict[str, str]  # of its channel
    log_ns: int
    publish_ns: int
    payload: bytes


class McapReader:
    """One MCAP file. After `entries` has ended the other attributes tell how it went.

    finished: it has its end. trouble: what is wrong with it, for a person. good: bytes from the beginning that were
    understood; messages: that were read. bad_chunks: chunks passed over; lost: earliest and latest log time of each, as
    far as it is known. orphans: messages of channels that nobody declared. facts: the metadata by name; descriptors: of
    each schema.
    """

    def __init__(self, file: BinaryIO, place: str) -> None:
        self.size = file.seek(0, SEEK_END)
        file.seek(0)
        self.good = 0
        self.messages = 0
        self.finished = False
        self.bad_chunks = 0
        self.orphans = 0
        self.lost: list[tuple[int, int]] = []
        self.facts: dict[str, dict[str, str]] = {}
        self.trouble: list[str] = []
        self._file = file
        self.descriptors: dict[str, bytes] = {}
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        if not self.size:
            raise RecordingError(f"{place}: it is empty; nothing had been written yet")
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC[: len(magic)]:
            raise RecordingError(f"{place}: not an MCAP file; it begins with {magic!r}")
        self.good = len(magic)

    @property
    def whole(self) -> bool:
        """Finished, and nothing in it is damaged."""
        return self.finished and not self.trouble

    def entries(self) -> Iterator[Entry]:
        """Every message that can be read, in the order it was written."""
        while (record := self._next()) is not None:
            opcode, body = record
            if opcode == Opcode.DATA_END:
                self.finished = self._ended()
                break
            yield from self._understood(opcode, body)
            self.good = self._file.tell()
        if not self.finished and not self.trouble:
            left = self.size - self.good
            self.trouble.append(
                f"it was not finished: a torn record is at its end, {count(left, 'byte')}"
                if left
                else "it was not finished"
            )
        if self.orphans:
            self.trouble.append(f"{count(self.orphans, 'message')} of channels that are not in the file")

    def _next(self) -> tuple[int, bytes] | None:
        """The next record, or None where no whole one begins; those that hold no messages come without a body."""
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        opcode, length = _HEAD.unpack(head)
        here = self._file.tell()
        if not opcode:
            self.trouble.append(f"from byte {self.good} on it is damaged; {count(self.size - self.good, 'byte')} lost")
            return None
        if length > self.size - here:
            if opcode == Opcode.CHUNK and self.size - here >= _SPAN.size:
                self.lost.append(_SPAN.unpack(self._file.read(_SPAN.size)))
            return None
        if opcode in _READ:
            return opcode, self._file.read(length)
        self._file.seek(here + length)
        return opcode, b""

    def _understood(self, opcode: int, body: bytes) -> Iterator[Entry]:
        try:
            records = _records(opcode, body)
        except Exception as error:  # noqa: BLE001 - a damaged record fails in many ways
            what = "a chunk" if opcode == Opcode.CHUNK else f"a record of kind {opcode}"
            self.trouble.append(f"{what} at byte {self.good} is damaged and passed over ({str(error)[:80]})")
            if opcode == Opcode.CHUNK:
                self.bad_chunks += 1
                self.lost.append(_SPAN.unpack_from(body) if len(body) >= _SPAN.size else (0, 0))
            return
        for record in records:
            if isinstance(record, Message):
                if (channel := self._channels.get(record.channel_id)) is None:
                    self.orphans += 1
                    continue
                schema = self._schemas.get(channel.schema_id, "")
                self.messages += 1
                yield Entry(channel.topic, schema, channel.metadata, record.log_time, record.publish_time, record.data)
            elif isinstance(record, Channel):
                self._channels[record.id] = record
            elif isinstance(record, Schema):
                self._schemas[record.id] = record.name
                self.descriptors[record.name] = record.data
            elif isinstance(record, Metadata):
                self.facts[record.name] = record.metadata

    def _ended(self) -> bool:
        """Whether the file has its end; of the summary only the number of messages is of interest."""
        self.good = self._file.tell()
        counted: int | None = None
        ended = False
        while not ended and (record := self._next()) is not None:
            opcode, body = record
            if opcode == Opcode.STATISTICS:
                with contextlib.suppress(Exception):  # as above
                    counted = Statistics.read(ReadDataStream(BytesIO(body))).message_count
            ended = opcode == Opcode.FOOTER and self._file.read(len(MCAP0_MAGIC) + 1) == MCAP0_MAGIC
        if ended:
            self.good = self.size
        if counted is not None and counted != self.messages:
            self.trouble.append(f"{self.messages} of {counted} messages could be read")
        elif not ended and not self.trouble:
            self.trouble.append("its summary is torn; all messages are there")
        return ended


def _records(opcode: int, body: bytes) -> list[McapRecord]:
    """What is in a record of a kind we read."""
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.CHUNK:
        chunk = Chunk.read(stream)
        chunk.data, chunk.compression = _unpacked(chunk), ""
        return breakup_chunk(chunk, validate_crc=True)
    if opcode == Opcode.CHANNEL:
        return [Channel.read(stream)]
    if opcode == Opcode.SCHEMA:
        return [Schema.read(stream)]
    return [Metadata.read(stream)] if opcode == Opcode.METADATA else []


# A message outside a chunk has no checksum; ours are in chunks.
_READ = {Opcode.CHUNK, Opcode.CHANNEL, Opcode.SCHEMA, Opcode.METADATA, Opcode.STATISTICS}


def _unpacked(chunk: Chunk) -> bytes:
    """The bytes of a chunk, never more than it says and than is taken."""
    size = chunk.uncompressed_size
    if size > MAX_UNPACKED:
        raise ValueError(f"it unpacks to {size} bytes, at most {MAX_UNPACKED} are taken")
    if chunk.compression == "zstd":
        said = zstandard.get_frame_parameters(chunk.data).content_size
        if said not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError(f"it unpacks to {said} bytes, not {size}")
        data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
    elif not chunk.compression:
        data = chunk.data
    else:
        raise ValueError(f"compressed by {chunk.compression[:16]!r}; zstd is read, or none")
    if len(data) != size:
        raise ValueError(f"it unpacks to {len(data)} bytes, not {size}")
    return data
