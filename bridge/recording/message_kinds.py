"""Kinds of messages that are recorded: schema, decoder and time of each kind.

The topic of an MCAP channel is the bus key without `truerate/@v1/<ward>/`; its metadata has the whole key.
"""

from collections.abc import Callable
from dataclasses import dataclass

from bridge.recording.mcap_writer import described
from bridge.wire import codec, keys
from bridge.wire import truerate_pb2 as pb
from bridge.wire.messages import (
    BiasRevision,
    Calibration,
    CorrectedBatch,
    DeviceInfo,
    Note,
    OrientationBatch,
    SampleBatch,
    Status,
)

#: largest difference between a message's own time and the recorder's clock at which the own time is the log time
MAX_APART_NS = 60_000_000_000

Said = SampleBatch | DeviceInfo | CorrectedBatch | OrientationBatch | Status | Calibration | BiasRevision | Note


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of recorded message: its schema name, decoder and time.

    decode(key, payload): decodes and validates a message, or raises Refusal. own_ns: name of the field with the
    message's own time, ns since the Unix epoch. repeated: True if every file begins with the latest message of this
    kind from each device, so that each file is readable alone.
    """

    schema: str
    decode: Callable[[str, bytes], Said]
    own_ns: str
    repeated: bool = False

    def time_ns(self, said: Said) -> int:
        """Return a message's own time, ns since the Unix epoch; for samples, the host time of the first sample.

        said: the decoded message, of this kind.
        """
        return int(getattr(said, self.own_ns))


KINDS: dict[str, Kind] = {
    "raw": Kind("SampleBatch", codec.decode_samples, "start_time_ns"),
    "corrected": Kind("CorrectedBatch", codec.decode_corrected, "start_time_ns"),
    "orientation": Kind("OrientationBatch", codec.decode_orientation, "start_time_ns"),
    "info": Kind("DeviceInfo", codec.decode_info, "time_ns", repeated=True),
    "status": Kind("Status", codec.decode_status, "time_ns", repeated=True),
    "calibration": Kind("Calibration", codec.decode_calibration, "time_ns", repeated=True),
    "revision": Kind("BiasRevision", codec.decode_revision, "time_ns"),
    "note": Kind("Note", codec.decode_note, "time_ns"),
}
SAMPLES = ("raw", "corrected")
#: messages between estimators, which say nothing new about the ward's devices; they are not recorded
PRIVATE = ("owned", "checkpoint")
PACKAGE = f"{pb.DESCRIPTOR.package}."
DESCRIPTORS = described(pb.DESCRIPTOR)


def topic(key: str) -> str:
    """Return the MCAP topic of a bus key: the key without `truerate/@v1/<ward>/`."""
    return key.split("/", 3)[3]


def log_ns(own_ns: int, now_ns: int) -> int:
    """Return the log time of a message, ns since the Unix epoch.

    own_ns: time that the message states. now_ns: time of the recorder. Both are ns since the Unix epoch.
    Returns own_ns; if the two differ by more than 60 s, returns now_ns.
    """
    return own_ns if abs(own_ns - now_ns) <= MAX_APART_NS else now_ns


def facts(key: str) -> dict[str, str]:
    """Return the metadata of an MCAP channel: the whole bus key (`key`), the ward, and the ids in the key by name.

    Raises Refusal for an invalid key.
    """
    place = keys.parse(key)
    return {"key": key, "ward": place.ward, **place.ids}
