"""MCAP reader for complete, unfinished and damaged files: reads every intact chunk and reports the damage.

The readers of the `mcap` package stop at the first damaged byte. This reader finds each record by its length, and the
package parses the record. After damage, reading resumes at the next chunk whose checksum matches.
"""

import struct
import zlib
from collections.abc import Iterator
from io import SEEK_END, BytesIO
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from bridge.recording.error import RecordingError
from bridge.terminal.plurals import count

#: limits against decompression bombs: unpacked bytes and records per chunk; writers make chunks of some megabytes
MAX_UNPACKED, MAX_RECORDS = 1 << 26, 200_000
_HEAD = struct.Struct("<BQ")  # header of a record: opcode, length
_FOOTER = struct.Struct("<BQQQI8s")  # opcode, length, starts of summary and its offsets, checksum; magic
_ZSTD = b"\4\0\0\0zstd"
_ZSTD_AT = _HEAD.size + 28  # offset in a chunk: after its header, times, size and checksum
_BLOCK = 1 << 20
_DAMAGED = (McapError, ValueError, struct.error, OverflowError, MemoryError, zstandard.ZstdError)


class Entry(NamedTuple):
    """Message of an MCAP file as it was written: topic, schema name, channel metadata, times and payload.

    log_ns, publish_ns: log time and publish time, ns since the Unix epoch.
    """

    topic: str
    schema: str
    facts: dict[str, str]  # metadata of its channel
    log_ns: int
    publish_ns: int
    payload: bytes


class McapReader:
    """Reader of the messages of one MCAP file, which may be unfinished or damaged.

    file: binary and seekable. place: its name in errors. Raises RecordingError if the file is empty or not MCAP.

    The attributes are complete when the iteration of `entries` has ended. finished: True if the file has its end
    record.
    trouble: faults of the file, as sentences. good: number of bytes read or skipped so far. size: number of bytes of
    the file. messages: number of messages read. facts: metadata by name. descriptors: schema data by schema name.
    """

    def __init__(self, file: BinaryIO, place: str) -> None:
        self.size = self._end = file.seek(0, SEEK_END)
        self.messages = 0
        self.finished = False
        self.facts: dict[str, dict[str, str]] = {}
        self.descriptors: dict[str, bytes] = {}
        self.trouble: list[str] = []
        self._file = file
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._orphans = 0
        if not self.size:
            raise RecordingError(
                f"{place}: the file is empty: the recorder stopped before its first write; use another recording"
            )
        file.seek(0)
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC[: len(magic)]:
            raise RecordingError(
                f"{place}: not an MCAP file, it begins with {magic!r}: give a file that `truerate record` wrote; "
                "for other files see `truerate recording convert --help`"
            )
        self.good = self._sought = len(magic)  # sought: where the search for the next chunk begins

    @property
    def whole(self) -> bool:
        """True if the file is finished and undamaged."""
        return self.finished and not self.trouble

    def entries(self) -> Iterator[Entry]:
        """Yield every readable message, in the order it was written.

        Damaged parts are skipped and reported in `trouble`.
        """
        counted = self._summarised()
        ended = False  # only the summary is torn
        damaged: int | None = None
        while self.good < self._end and not ended:
            self._file.seek(self.good)
            try:
                records = self._records(sure=damaged is not None)
            except _DAMAGED:
                damaged = self._sought if damaged is None else damaged
                if not self._resumed():
                    break
                continue
            if damaged is not None:
                self.trouble.append(f"damaged between byte {damaged} and byte {self.good}: the messages there are lost")
                damaged = None
            ended = records is None
            yield from self._entries(records or ())
            self.good = self._file.tell()
        self._judge(counted, damaged, ended=ended)

    def _summarised(self) -> int | None:
        """Return the number of messages according to the summary; None if there is no intact summary.

        Channels are declared from the summary too, in case the chunk that declares them is damaged.
        """
        self._file.seek(max(0, self.size - _FOOTER.size))
        foot = self._file.read()
        if len(foot) < _FOOTER.size or foot[0] != Opcode.FOOTER or not foot.endswith(MCAP0_MAGIC):
            return None
        self.finished = True
        *_, start, _, checksum, _ = _FOOTER.unpack(foot)
        try:
            self._file.seek(start)
            if zlib.crc32(self._file.read(max(0, self.size - start - 12))) != checksum:
                raise ValueError
            self._file.seek(0)
            summary: Summary | None = make_reader(self._file).get_summary()
        except _DAMAGED:
            summary = None
        if summary is None:
            self.trouble.append("the summary is damaged")
            return None
        self._end = start
        for declared in (*summary.schemas.values(), *summary.channels.values()):
            self._declare(declared)
        return summary.statistics.message_count if summary.statistics else None

    def _records(self, *, sure: bool) -> list[McapRecord] | None:
        """Return the content of the next record; None if no messages follow. Raises one of _DAMAGED.

        sure: only a chunk is accepted, as after damage.
        """
        opcode, length = _HEAD.unpack(self._file.read(_HEAD.size))
        here = self._file.tell()
        if not opcode or length > self._end - here or (sure and opcode != Opcode.CHUNK):
            raise ValueError
        if opcode == Opcode.CHUNK:
            records = _unpacked(Chunk.read(ReadDataStream(BytesIO(self._file.read(length)))))
            self._sought = here + length
            return records
        if opcode in (Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL):
            read = {Opcode.METADATA: Metadata.read, Opcode.SCHEMA: Schema.read, Opcode.CHANNEL: Channel.read}[opcode]
            return [read(ReadDataStream(BytesIO(self._file.read(length))))]
        self._file.seek(here + length)
        return None if opcode in (Opcode.DATA_END, Opcode.FOOTER) else []

    def _resumed(self) -> bool:
        """Move to the next possible chunk; False if there is none."""
        at = self._sought + _ZSTD_AT
        while at < self._end:
            self._file.seek(at)
            hit = self._file.read(_BLOCK).find(_ZSTD)
            if hit >= 0:
                self.good = at + hit - _ZSTD_AT
                self._sought = self.good + 1
                return True
            at += _BLOCK - len(_ZSTD) + 1
        return False

    def _entries(self, records: list[McapRecord] | tuple[()]) -> Iterator[Entry]:
        for record in records:
            if isinstance(record, Message):
                if (channel := self._channels.get(record.channel_id)) is None:
                    self._orphans += 1
                    continue
                self.messages += 1
                schema = self._schemas.get(channel.schema_id, "")
                yield Entry(channel.topic, schema, channel.metadata, record.log_time, record.publish_time, record.data)
            else:
                self._declare(record)

    def _declare(self, record: McapRecord) -> None:
        if isinstance(record, Channel):
            self._channels[record.id] = record
        elif isinstance(record, Schema):
            self._schemas[record.id] = record.name
            self.descriptors[record.name] = record.data
        elif isinstance(record, Metadata):
            self.facts[record.name] = record.metadata

    def _judge(self, counted: int | None, damaged: int | None, *, ended: bool) -> None:
        """Add to `trouble` what is wrong with the file, after reading it."""
        if ended and not self.finished:
            self.trouble.append("the summary is torn" + ("" if self.trouble else "; all messages are readable"))
        elif damaged is not None:
            torn = (
                "the file is damaged" if self.finished else "the recording was not finished and ends in a torn record"
            )
            self.trouble.append(f"from byte {damaged} on {torn}: {count(self._end - damaged, 'byte')} not read")
        elif not self.finished:
            self.trouble.append("the recording was not finished")
        if counted is not None and counted != self.messages:
            self.trouble.append(f"{self.messages} of {counted} messages could be read")
        elif self._orphans:
            self.trouble.append(f"{count(self._orphans, 'message')} of channels missing in the file")
        self.good = self.size


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    """Return the records of a chunk. Raises one of _DAMAGED if it is too large or damaged."""
    size = chunk.uncompressed_size
    if chunk.compression == "zstd" and zstandard.get_frame_parameters(chunk.data).content_size not in (
        size,
        zstandard.CONTENTSIZE_UNKNOWN,
    ):
        raise ValueError
    if size > MAX_UNPACKED or chunk.compression not in ("zstd", ""):
        raise ValueError
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    records = list[McapRecord]()
    while stream.count < size:
        opcode, length = stream.read1(), stream.read8()
        if length > size - stream.count or len(records) >= MAX_RECORDS:
            raise ValueError
        if opcode == Opcode.MESSAGE:
            records.append(Message.read(stream, length))
        elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            records.append((Channel if opcode == Opcode.CHANNEL else Schema).read(stream))
        else:
            raise ValueError
    return records
