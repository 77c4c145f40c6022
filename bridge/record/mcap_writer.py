"""MCAP out, onto any binary file: small chunks, each written whole or taken back, a summary at the end.

The records are the `mcap` package's. Its own writer cannot be told to end a chunk now, which is what a recording that
may be cut at any moment needs, so chunks are put together here. https://mcap.dev/spec
"""

import struct
import zlib
from io import SEEK_SET
from typing import BinaryIO

import zstandard
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

#: a chunk ends here, if nobody ended it before
CHUNK_BYTES = 1 << 20
MAX_CHANNELS = 20_000
LIBRARY = "truerate"
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_AFTER_LENGTH = 22  # bytes of it that its length counts


def described(file: FileDescriptor) -> bytes:
    """The schema data of a .proto file's messages: a FileDescriptorSet. For a file that imports none."""
    proto = FileDescriptorProto()
    file.CopyToProto(proto)
    return FileDescriptorSet(file=[proto]).SerializeToString()


class McapWriter:
    """One MCAP file. A message is safe once the `flush` after it has returned; `pending` ones are not yet.

    When the file refuses (OSError), what was written of the chunk is taken back, its messages are counted in `lost`, and
    the file is as good as it was: whole chunks only.
    """

    def __init__(self, file: BinaryIO, name: str, facts: dict[str, str]) -> None:
        self.messages = 0
        self.pending = 0
        self.lost = 0
        self.finished = False
        self.size = 0
        self._file = file
        self._compress = zstandard.ZstdCompressor(level=1).compress
        self._schemas: dict[str, Schema] = {}
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}  # messages by channel, of whole chunks
        self._sequences: dict[int, int] = {}  # number of the last message by channel
        self._chunk_indexes: list[bytes] = []
        self._span = _Span()
        self._begin_chunk()
        head = MCAP0_MAGIC + _bytes(Header("", LIBRARY))
        about = _bytes(Metadata(name, facts))
        self._metadata_index = MetadataIndex(len(head), len(about), name)
        self._write(head + about)

    def channel(self, topic: str, schema: str, descriptors: bytes, facts: dict[str, str]) -> int:
        """A new channel of protobuf messages; its number."""
        records = b""
        if schema not in self._schemas:
            self._schemas[schema] = Schema(
                id=len(self._schemas) + 1, name=schema, encoding="protobuf", data=descriptors
            )
            records = _bytes(self._schemas[schema])
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding="protobuf",
            metadata=facts,
            schema_id=self._schemas[schema].id,
        )
        self._channels.append(channel)
        self._counts[channel.id] = self._sequences[channel.id] = 0
        # Ahead of the chunk, not in it: a chunk that is damaged later takes no channel with it.
        self._declarations += records + _bytes(channel)
        return channel.id

    def add(self, channel: int, log_ns: int, publish_ns: int, payload: bytes) -> None:
        """One message, as it came."""
        sequence = self._sequences[channel] = self._sequences[channel] + 1
        length = _AFTER_LENGTH + len(payload)
        head = _MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_ns, publish_ns)
        self._parts += (head, payload)
        self._index.setdefault(channel, []).extend((log_ns, self._chunk_bytes))
        self._chunk_bytes += 9 + length
        self._chunk_span.add(log_ns)
        self.pending += 1
        if self._chunk_bytes >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """End the chunk and hand it to the file."""
        if not self.pending and not self._declarations:
            return
        declarations, records, pending = self._declarations, b"".join(self._parts), self.pending
        index, span = self._index, self._chunk_span
        self._begin_chunk()
        if not pending:
            self._write(declarations)
            return
        packed = self._compress(records)
        chunk = _bytes(
            Chunk(
                compression="zstd",
                data=packed,
                message_start_time=span.first,
                message_end_time=span.last,
                uncompressed_crc=zlib.crc32(records),
                uncompressed_size=len(records),
            )
        )
        start = self.size + len(declarations)
        indexes, offsets = _message_indexes(index, start + len(chunk))
        self.lost += pending
        self._write(declarations + chunk + indexes)
        self.lost -= pending
        self.messages += pending
        for channel, entries in index.items():
            self._counts[channel] += len(entries) // 2
        self._span.add(span.first)
        self._span.add(span.last)
        self._chunk_indexes.append(
            _bytes(
                ChunkIndex(
                    chunk_start_offset=start,
                    chunk_length=len(chunk),
                    message_start_time=span.first,
                    message_end_time=span.last,
                    message_index_offsets=offsets,
                    message_index_length=len(indexes),
                    compression="zstd",
                    compressed_size=len(packed),
                    uncompressed_size=len(records),
                )
            )
        )

    def finish(self) -> None:
        """Write what is pending, the summary and the end, once. The file is not closed."""
        if self.finished:
            return
        self.flush()
        end = _bytes(DataEnd(0))
        summary_start = self.size + len(end)
        groups = (
            (Opcode.SCHEMA, [_bytes(schema) for schema in self._schemas.values()]),
            (Opcode.CHANNEL, [_bytes(channel) for channel in self._channels]),
            (Opcode.STATISTICS, [_bytes(self._statistics())]),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.METADATA_INDEX, [_bytes(self._metadata_index)]),
        )
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(records)
            if group:
                offsets += _bytes(SummaryOffset(opcode, summary_start + len(summary), len(group)))
            summary += group
        footer = Footer(summary_start, summary_start + len(summary), 0)
        summary += offsets
        footer.summary_crc = zlib.crc32(summary + _bytes(footer)[:-4])
        self._write(end + summary + _bytes(footer) + MCAP0_MAGIC)
        self.finished = True

    def _begin_chunk(self) -> None:
        self._declarations = b""
        self._parts: list[bytes] = []
        self._index: dict[int, list[int]] = {}
        self._chunk_bytes = 0
        self._chunk_span = _Span()
        self.pending = 0

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunk_indexes),
            message_count=self.messages,
            message_start_time=self._span.first,
            message_end_time=self._span.last,
            metadata_count=1,
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> None:
        """All of it or, with OSError, nothing: an unbuffered file may take a part and then be full."""
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError:
            self._file.seek(self.size, SEEK_SET)
            self._file.truncate()
            raise
        self.size += len(data)


class _Span:
    """The earliest and the latest of some times; 0 when there is none."""

    __slots__ = ("first", "last")

    def __init__(self) -> None:
        self.first = self.last = 0

    def add(self, time_ns: int) -> None:
        if not self.first or time_ns < self.first:
            self.first = time_ns
        self.last = max(self.last, time_ns)


def _message_indexes(index: dict[int, list[int]], start: int) -> tuple[bytes, dict[int, int]]:
    """The message index records of a chunk, the first of which is at `start` in the file; where that of each channel is."""
    builder, offsets = RecordBuilder(), {}
    for channel, entries in index.items():
        offsets[channel] = start + builder.count
        builder.start_record(Opcode.MESSAGE_INDEX)
        builder.write2(channel)
        builder.write4(8 * len(entries))
        builder.write(struct.pack(f"<{len(entries)}Q", *entries))
        builder.finish_record()  # type: ignore[no-untyped-call]
    return _built(builder), offsets


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return _built(builder)


def _built(builder: RecordBuilder) -> bytes:
    return bytes(builder.end())  # type: ignore[no-untyped-call]
