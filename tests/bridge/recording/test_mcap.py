"""MCAP written is what the package's own reader reads; cut or flipped anywhere, what is whole is read, never more."""

import errno
import functools
import struct
import time
import zlib
from io import BytesIO

import pytest
import zstandard
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC

from bridge.recording import message_kinds
from bridge.recording.mcap_reader import MAX_UNPACKED, Entry, McapReader
from bridge.recording.mcap_writer import McapWriter
from bridge.wire import codec
from tests.bridge.recording.crowd import samples

BEGIN_NS = 1_790_000_000_000_000_000
TOPICS = ("raw/bridge-1/one", "raw/bridge-1/two")


def write(file: BytesIO, chunks: int = 5, each: int = 4, *, finish: bool = True) -> list[int]:
    """Some chunks on two channels, the second of which begins in the third; where the file was safe after each."""
    writer = McapWriter(file, "truerate", {"ward": "w"})
    safe = []
    for chunk in range(chunks):
        for number in range(each):
            topic = TOPICS[number % 2 if chunk >= 2 else 0]
            channel = writer.channel(topic, "truerate.v1.SampleBatch", message_kinds.DESCRIPTORS, {"key": topic})
            at = chunk * each + number
            writer.add(channel, BEGIN_NS + at, BEGIN_NS - at, payload(at))
        writer.flush()
        safe.append(writer.size)
    if finish:
        writer.finish()
    return safe


@functools.cache
def payload(at: int) -> bytes:
    return codec.encode_samples(samples("one", 5 * at, 5, BEGIN_NS + at))


def read(data: bytes) -> tuple[list[Entry], McapReader]:
    reader = McapReader(BytesIO(data), "x")
    return list(reader.entries()), reader


def test_the_packages_own_reader_reads_it_with_index_and_checksums() -> None:
    file = BytesIO()
    write(file)
    file.seek(0)
    reader = make_reader(file, validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert (summary.statistics.message_count, summary.statistics.chunk_count) == (20, 5)
    assert summary.statistics.channel_message_counts == {1: 14, 2: 6}
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (BEGIN_NS, BEGIN_NS + 19)
    assert [channel.topic for channel in summary.channels.values()] == list(TOPICS)
    found = list(reader.iter_messages())
    assert [message.data for _, _, message in found] == [payload(at) for at in range(20)]
    assert [message.publish_time for _, _, message in found] == [BEGIN_NS - at for at in range(20)]
    (of_two,) = [[m.log_time - BEGIN_NS for _, _, m in reader.iter_messages(topics=[TOPICS[1]])]]
    assert of_two == [9, 11, 13, 15, 17, 19]
    assert [m.log_time - BEGIN_NS for _, _, m in reader.iter_messages(reverse=True)] == list(range(19, -1, -1))
    ((record),) = reader.iter_metadata()
    assert (record.name, record.metadata) == ("truerate", {"ward": "w"})


def test_it_describes_itself() -> None:
    """A reader that has never heard of us decodes a batch by the schema in the file."""
    file = BytesIO()
    write(file)
    file.seek(0)
    schema, _, message = next(iter(make_reader(file).iter_messages()))
    assert schema is not None
    assert schema.encoding == "protobuf"
    pool = descriptor_pool.DescriptorPool()
    for proto in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(proto)
    batch = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))()
    batch.ParseFromString(message.data)
    assert list(batch.gyro) == samples_of(0)  # type: ignore[attr-defined] # a class made just now


def samples_of(at: int) -> list[float]:
    batch = codec.decode_samples("truerate/@v1/w/raw/bridge-1/one", payload(at))
    return [float(value) for value in batch.gyro.ravel()]


@pytest.mark.parametrize("finish", [False, True])
def test_cut_at_any_byte_every_chunk_before_is_there(finish: bool) -> None:
    file = BytesIO()
    safe = write(file, finish=finish)
    data = file.getvalue()
    for end in range(safe[2], len(data) if not finish else safe[-1] + 1000, 7):
        entries, reader = read(data[:end])
        whole = sum(place <= end for place in safe)
        # The records after a chunk's messages are its index: without it the chunk is as good.
        assert len(entries) in (4 * whole, 4 * whole + 4)
        assert [entry.payload for entry in entries] == [payload(at) for at in range(len(entries))]
        assert reader.trouble
        assert not reader.finished


@pytest.mark.parametrize("hurt", [b"", bytes(20), b"\xff" * 20])
def test_any_damaged_bytes_cost_their_chunk_at_most(hurt: bytes) -> None:
    """A bit, or some bytes: never a wrong message, never an exception, and reading goes on at the next chunk."""
    file = BytesIO()
    write(file)
    data = file.getvalue()
    wanted = {payload(at) for at in range(20)}
    for at in range(8, len(data) - len(hurt), 17):
        damage = hurt or bytes([data[at] ^ 1 << at % 8])
        entries, reader = read(data[:at] + damage + data[at + len(damage) :])
        payloads = [entry.payload for entry in entries]
        assert {entry.topic for entry in entries} == set(TOPICS)
        assert set(payloads) <= wanted
        assert len(payloads) == len(set(payloads)) >= 16
        if len(payloads) < 20:
            assert reader.trouble
            assert not reader.whole


class Full(BytesIO):
    """A disk with so much room; like a raw file, it takes a part before it says so."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data: bytes) -> int:  # type: ignore[override] # a buffer is one
        taken = min(len(data), self.room - self.tell())
        if taken <= 0 and len(data):
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data[:taken])


def test_a_full_disk_keeps_whole_chunks_only() -> None:
    whole = BytesIO()
    safe = write(whole, finish=False)
    for room in range(safe[1], safe[3], 7):
        file = Full(room)
        with pytest.raises(OSError, match="No space"):
            write(file)
        held = max(place for place in safe if place <= room)
        assert file.getvalue() == whole.getvalue()[:held]


def bomb(inside: bytes, said: int | None = None) -> bytes:
    """A chunk that unpacks to this, which its checksum fits. said: the size that it states; default: the true one."""
    packed = zstandard.compress(inside, 3)
    size = len(inside) if said is None else said
    chunk = struct.pack("<QQQII", 0, 0, size, zlib.crc32(inside), 4) + b"zstd" + struct.pack("<Q", len(packed))
    return MCAP0_MAGIC + struct.pack("<BQ", Opcode.CHUNK, len(chunk) + len(packed)) + chunk + packed


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (bytes(MAX_UNPACKED), None),
        (bytes(MAX_UNPACKED + 1), None),
        (bytes(MAX_UNPACKED), 1 << 10),
        (bytes(MAX_UNPACKED), 1 << 62),
        (struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 1, 0, 0, 0) * 1_000_000, None),
        (struct.pack("<BQ", Opcode.MESSAGE, 1 << 62) * 1000, None),
    ],
    ids=[
        "no records",
        "too large",
        "said to be small",
        "said to be huge",
        "a million messages",
        "a length beyond the end",
    ],
)
def test_a_small_file_that_unpacks_to_a_large_one_costs_a_moment(inside: bytes, said: int | None) -> None:
    data = bomb(inside, said)
    assert len(data) < 100_000
    began = time.process_time()
    entries, reader = read(data)
    assert time.process_time() - began < 5.0
    assert entries == []
    assert not reader.whole
    assert "torn" in reader.trouble[0]
