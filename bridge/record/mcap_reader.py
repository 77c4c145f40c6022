"""MCAP in, from any binary file, however it ended: what is whole is read, what is not is told.

The readers of the `mcap` package give up at the first byte they do not understand, some before the first message. Here
each record is framed by its length, and stands or falls by itself; its content is read by the package. A chunk whose
checksum does not hold is passed over. Where a length, or a kind, is damaged, reading goes on at the next chunk.
"""

import contextlib
import re
import struct
import zlib
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
_TORN = struct.Struct("<QQQIi4s")  # how a chunk begins: its span, its size, its checksum, and what it is packed by
_ZSTD = b"\4\0\0\0zstd"
#: of the records that are needed: how they begin
_BEGIN = re.compile(rb"(?=[\x03\x04\x0c].{3}\0{5}|\x06.{4}\0{4}.{28}" + _ZSTD + b")", re.DOTALL)
_FOOTER = _HEAD.pack(Opcode.FOOTER, 20)
_END = struct.Struct("<BQQQI8s")  # the footer, where the summary begins and its checksum in it, and the magic
_DATA_END = _HEAD.size + 4  # bytes of the record before the summary
_BLOCK = 1 << 16


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
        self._end = self.size  # of what holds messages
        self.descriptors: dict[str, bytes] = {}
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        if not self.size:
            raise RecordingError(f"{place}: it is empty; nothing had been written yet")
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC[: len(magic)]:
            raise RecordingError(f"{place}: not an MCAP file; it begins with {magic!r}")
        self.good = self._sure = len(magic)  # behind the last chunk that was whole
        self._since = set[int]()  # where other records are, since then, that were understood

    @property
    def whole(self) -> bool:
        """Finished, and nothing in it is damaged."""
        return self.finished and not self.trouble

    def entries(self) -> Iterator[Entry]:
        """Every message that can be read, in the order it was written."""
        counted, ended = self._looked_ahead(), False
        while not ended:
            record = self._next()
            if record is None:
                if self.good == self._end or not self._resumed():
                    break
                continue
            ended = record[0] == Opcode.DATA_END and counted is None  # else it is known where the end is
            yield from self._understood(*record)
            self.good = self._file.tell()
        if self.finished:
            self.good = self.size
            if counted is not None and counted != self.messages:
                self.trouble.append(f"{self.messages} of {counted} messages could be read")
        else:
            self.trouble.append(self._unfinished(ended=ended))
        if self.orphans:
            self.trouble.append(f"{count(self.orphans, 'message')} of channels that are not in the file")

    def _looked_ahead(self) -> int | None:
        """How many messages a finished file says it has, and its channels and schemas, which its summary has under a checksum.

        None where there is no such summary.
        """
        self._file.seek(max(0, self.size - _END.size))
        foot = self._file.read(_END.size)
        counted: int | None = None
        if len(foot) == _END.size and foot.startswith(_FOOTER) and foot.endswith(MCAP0_MAGIC):
            self.finished = True
            *_, start, _, checksum, _ = _END.unpack(foot)
            if start and checksum == self._checksum(start):
                self._file.seek(start)
                while (record := self._next()) is not None and record[0] != Opcode.FOOTER:
                    with contextlib.suppress(Exception):  # as below
                        for one in _records(record[0], ReadDataStream(BytesIO(record[1]))):
                            counted = one.message_count if isinstance(one, Statistics) else counted
                            self._declared(one)
                self._end = start - _DATA_END
            elif start and checksum:
                self.trouble.append("its summary is damaged")
        self._file.seek(self.good)
        return counted

    def _checksum(self, start: int) -> int:
        """Of the summary that begins there, as far as the footer's own."""
        left, checksum = self.size - len(MCAP0_MAGIC) - 4 - start, 0
        if start < self.good or left < 0:
            return 0
        self._file.seek(start)
        while block := self._file.read(min(_BLOCK, left)):
            left, checksum = left - len(block), zlib.crc32(block, checksum)
        return checksum

    def _next(self) -> tuple[int, bytes] | None:
        """The next record, or None where no whole one begins; those that hold no messages come without a body."""
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        opcode, length = _HEAD.unpack(head)
        here = self._file.tell()
        if not opcode or length > self._end - here:
            return None
        if opcode in _READ:
            return opcode, self._file.read(length)
        self._file.seek(here + length)
        return opcode, b""

    def _resumed(self) -> bool:
        """Go on behind the damage, at the next chunk that is whole or what declares its channels; False where there is none."""
        self._file.seek(self.good)
        head = self._file.read(_HEAD.size + _TORN.size)
        if len(head) == _HEAD.size + _TORN.size and head[0] == Opcode.CHUNK and head.endswith(_ZSTD):
            self.lost.append(_TORN.unpack_from(head, _HEAD.size)[:2])
        # A length that was damaged may have led past whole chunks, so it is searched from the last one that was understood.
        since, found = self._sure, self._sought()
        if found is not None or self.finished:
            self.good = self._sure = self._end if found is None else found
            self.trouble.append(
                f"between byte {since} and byte {self.good} it is damaged; what was there is passed over"
            )
        self._file.seek(self.good)
        return found is not None

    def _sought(self) -> int | None:
        """Where the next record that is needed, and is whole, begins."""
        at = self._sure + 1
        while True:
            self._file.seek(at)
            block = self._file.read(_BLOCK)
            for hit in _BEGIN.finditer(block):
                self._file.seek(at + hit.start())
                record = self._next()
                if record is not None and at + hit.start() not in self._since and _holds(*record):
                    return at + hit.start()
            if len(block) < _BLOCK or at > self._end:
                return None
            at += _BLOCK - _HEAD.size - _TORN.size

    def _understood(self, opcode: int, body: bytes) -> Iterator[Entry]:
        stream = ReadDataStream(BytesIO(body))
        try:
            records = _records(opcode, stream)
        except Exception as error:  # noqa: BLE001 - a damaged record fails in many ways
            what = "a chunk" if opcode == Opcode.CHUNK else f"a record of kind {opcode}"
            self.trouble.append(f"{what} at byte {self.good} is damaged and passed over ({str(error)[:80]})")
            if opcode == Opcode.CHUNK:
                self.bad_chunks += 1
                self.lost.append(_SPAN.unpack_from(body) if len(body) >= _SPAN.size else (0, 0))
                self._sure = self.good
            return
        if opcode == Opcode.CHUNK:
            self._sure = self.good + _HEAD.size + stream.count
            self._since.clear()
        elif opcode in _READ:
            self._since.add(self.good)
        for record in records:
            if isinstance(record, Message):
                if (channel := self._channels.get(record.channel_id)) is None:
                    self.orphans += 1
                    continue
                schema = self._schemas.get(channel.schema_id, "")
                self.messages += 1
                yield Entry(channel.topic, schema, channel.metadata, record.log_time, record.publish_time, record.data)
            elif isinstance(record, Metadata):
                self.facts[record.name] = record.metadata
            else:
                self._declared(record)

    def _declared(self, record: McapRecord) -> None:
        """A channel or a schema counts as it was said first: what a checksum held for, if anything."""
        if isinstance(record, Channel):
            self._channels.setdefault(record.id, record)
        elif isinstance(record, Schema) and record.id not in self._schemas:
            self._schemas[record.id] = record.name
            self.descriptors[record.name] = record.data

    def _unfinished(self, *, ended: bool) -> str:
        """What is to be said of a file without an end; ended: only its summary is torn."""
        if ended:
            return "its summary is torn" + ("" if self.trouble else "; all messages are there")
        left = self.size - self.good
        self._file.seek(self.good)
        if self._file.read(1) == b"\0":
            return f"from byte {self.good} on it is damaged; {count(left, 'byte')} lost"
        return "it was not finished" + (f": a torn record is at its end, {count(left, 'byte')}" if left else "")


def _records(opcode: int, stream: ReadDataStream) -> list[McapRecord]:
    """What is in a record of a kind we read."""
    if opcode == Opcode.CHUNK:
        chunk = Chunk.read(stream)
        chunk.data, chunk.compression = _unpacked(chunk), ""
        return breakup_chunk(chunk, validate_crc=True)
    if opcode == Opcode.CHANNEL:
        return [Channel.read(stream)]
    if opcode == Opcode.SCHEMA:
        return [Schema.read(stream)]
    if opcode == Opcode.STATISTICS:
        return [Statistics.read(stream)]
    return [Metadata.read(stream)] if opcode == Opcode.METADATA else []


def _holds(opcode: int, body: bytes) -> bool:
    """Whether it is such a record, and not what looks like the beginning of one."""
    stream = ReadDataStream(BytesIO(body))
    with contextlib.suppress(Exception):  # as above
        _records(opcode, stream)
        return stream.count == len(body)
    return False


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
