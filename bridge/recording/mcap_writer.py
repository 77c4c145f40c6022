"""MCAP writer for recordings that may be interrupted at any moment.

A flushed chunk is in the file completely or not at all. The Writer of the `mcap` package writes the records. Format:
https://mcap.dev/spec
"""

from collections import Counter
from io import BytesIO
from typing import BinaryIO, Final, NamedTuple

from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from mcap.writer import Writer

#: most bytes held in memory between two flushes
HELD_BYTES = 1 << 20
#: most channels of a file
MAX_CHANNELS = 20_000
LIBRARY = "truerate"


class Encoding(NamedTuple):
    """Encoding of a schema and of its messages, by names of the MCAP specification, such as ros2msg and cdr."""

    schema: str
    message: str


PROTOBUF: Final = Encoding("protobuf", "protobuf")
ROS2: Final = Encoding("ros2msg", "cdr")


def described(file: FileDescriptor) -> bytes:
    """Return the schema data (a serialised FileDescriptorSet) of a .proto file that imports no other."""
    proto = FileDescriptorProto()
    file.CopyToProto(proto)
    return FileDescriptorSet(file=[proto]).SerializeToString()


class _Held(BytesIO):
    """Buffer for `file`: `flush` appends everything written since the last flush or, with OSError, nothing."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__()
        self.size = 0
        self._file = file

    def tell(self) -> int:
        """Position in the file, including held bytes."""
        return self.size + super().tell()

    def flush(self) -> None:
        """Append the held bytes to the file; an unbuffered write may take a part and then find the disk full."""
        data = self.getvalue()
        self.seek(0)
        self.truncate()
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError:
            self._file.seek(self.size)
            self._file.truncate()
            raise
        self.size += len(data)


class McapWriter:
    """Writer of one MCAP file. A message is in the file when the next `flush` after `add` has returned.

    file: binary, open for writing. name, facts: name and content of the metadata record at the beginning of the file.
    messages: number of messages in the file. pending: number of messages not yet flushed.
    After an OSError, the file contains all flushed messages. The `pending` messages are lost, and no message can
    be added.
    Raises OSError if the beginning cannot be written.
    """

    def __init__(self, file: BinaryIO, name: str, facts: dict[str, str]) -> None:
        self.messages = 0
        self.pending = 0
        self._held = _Held(file)
        self._writer = Writer(self._held)
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._sequences = Counter[int]()
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(name, facts)
        self._held.flush()

    @property
    def size(self) -> int:
        """Number of bytes in the file, without messages not yet flushed."""
        return self._held.size

    def channel(
        self, topic: str, schema: str, definition: bytes, facts: dict[str, str], *, encoding: Encoding = PROTOBUF
    ) -> int:
        """Return the channel number for a topic and schema, for use in `add`; the first call adds the channel.

        schema, definition: name and data of the schema. facts: metadata of the channel. encoding: of the schema and of
        the channel's messages.
        """
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(schema, encoding.schema, definition)
        if (topic, schema) not in self._channels:
            number = self._writer.register_channel(topic, encoding.message, self._schemas[schema], facts)
            self._channels[topic, schema] = number
        return self._channels[topic, schema]

    def add(self, channel: int, log_ns: int, publish_ns: int, payload: bytes) -> None:
        """Add one message to a channel; flushes if HELD_BYTES or more are not yet flushed.

        channel: number from `channel`. log_ns, publish_ns: log time and publish time, ns since the Unix epoch.
        payload: the encoded message. Raises OSError if that flush fails.
        """
        self._sequences[channel] += 1
        self._writer.add_message(channel, log_ns, payload, publish_ns, self._sequences[channel] & 0xFFFFFFFF)
        self.pending += 1
        if self._held.tell() - self._held.size >= HELD_BYTES:
            self.flush()

    def flush(self) -> None:
        """Append the pending messages to the file as one MCAP chunk, completely or not at all.

        Raises OSError if the write fails, for example on a full disk.
        """
        self._writer.flush()  # type: ignore[no-untyped-call]
        self.messages += self.pending
        self.pending = 0

    def finish(self) -> None:
        """Write the pending messages, the summary and the end record; the file stays open.

        Raises OSError if the write fails.
        """
        self.flush()
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._held.flush()
