"""Writers of MCAP files of a ward's messages, with one channel per bus key: of any file, and of a recorder's file."""

from collections import Counter
from pathlib import Path
from typing import BinaryIO, NamedTuple

from bridge.recording import message_kinds
from bridge.recording.files import Output, with_part
from bridge.recording.mcap_writer import MAX_CHANNELS, McapWriter
from bridge.recording.message_kinds import Kind
from bridge.wire import keys

#: name of the metadata record at the beginning of every truerate file
ABOUT = "truerate"
#: most channels for one bridge: a bridge that invents devices leaves room to the others
MOST_OF_A_BRIDGE = MAX_CHANNELS // 8


class Item(NamedTuple):
    """Message to be written: its bus key, kind and encoded payload.

    own_ns: the message's own time, ns since the Unix epoch.
    """

    key: str
    kind: Kind
    own_ns: int
    payload: bytes


class WardFile:
    """MCAP file of a ward's messages, with one channel per bus key.

    ward: id for the file's metadata. writer: the McapWriter of the file, with methods to flush and finish it.
    Raises OSError if the beginning of the file cannot be written.
    """

    def __init__(self, file: BinaryIO, ward: str) -> None:
        self.writer = McapWriter(file, ABOUT, {"ward": ward, "version": "1"})
        self._channels: dict[str, int] = {}
        self._of_bridges = Counter[str]()

    def put(self, item: Item, log_ns: int) -> bool:
        """Write a message to the channel of its bus key; a new key gets a new channel.

        log_ns: log time, ns since the Unix epoch.
        Returns True if the message is written. Returns False if it needs a new channel, but the file or the message's
        bridge already has the largest allowed number of channels.
        Raises OSError if the write fails.
        """
        channel = self._channels.get(item.key)
        if channel is None:
            bridge = keys.parse(item.key).ids.get("bridge", "")
            if len(self._channels) >= MAX_CHANNELS or (bridge and self._of_bridges[bridge] >= MOST_OF_A_BRIDGE):
                return False
            self._of_bridges[bridge] += 1
            schema = message_kinds.PACKAGE + item.kind.schema
            facts = message_kinds.facts(item.key)
            channel = self.writer.channel(message_kinds.topic(item.key), schema, message_kinds.DESCRIPTORS, facts)
            self._channels[item.key] = channel
        self.writer.add(channel, log_ns, item.own_ns, item.payload)
        return True


class RecordingFile(WardFile):
    """MCAP file that a recorder is writing. ward: id for the file's metadata. output: the open file.

    Raises OSError if the beginning of the file cannot be written; the file is then deleted.
    """

    def __init__(self, output: Output, ward: str) -> None:
        self.output = output
        try:
            super().__init__(output.file, ward)
        except OSError:
            output.discard()
            raise

    def left(self, *, writable: bool) -> Path | None:
        """Close the file after an error and return its path; a file without messages is deleted, and None returned.

        writable: True if the disk may still accept data; the file is then finished. If finishing fails, or writable is
        False, the file stays unfinished and its path ends in .part.
        """
        path = self.output.path
        try:
            if not self.writer.messages:
                self.output.discard()
                return None
            if writable:
                self.writer.finish()
                self.output.finish()
                return path
        except OSError:
            pass
        self.output.file.close()
        return with_part(path)
