"""Kinds of messages that are recorded: schema, decoder and time of each.

A channel's topic is the key without `truerate/@v1/<ward>/`; the whole key is in the channel's metadata.
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
    SampleBatch,
    Status,
)

#: a message's own time is its log time unless it is further than this from the recorder's clock
MAX_APART_NS = 60_000_000_000

Said = SampleBatch | DeviceInfo | CorrectedBatch | Status | Calibration | BiasRevision | Note


@dataclass(frozen=True, slots=True)
class Kind:
    """decode(key, payload) is the codec's; own_ns names the time a message says of itself.

    repeated: the latest of each device begins every file, so that a file can be understood by itself.
    """

    schema: str
    decode: Callable[[str, bytes], Said]
    own_ns: str
    repeated: bool = False

    def time_ns(self, said: Said) -> int:
        """The time in the message; of samples, the host time of the first."""
        return int(getattr(said, self.own_ns))


KINDS: dict[str, Kind] = {
    "raw": Kind("SampleBatch", codec.decode_samples, "start_time_ns"),
    "corrected": Kind("CorrectedBatch", codec.decode_corrected, "start_time_ns"),
    "info": Kind("DeviceInfo", codec.decode_info, "time_ns", repeated=True),
    "status": Kind("Status", codec.decode_status, "time_ns", repeated=True),
    "calibration": Kind("Calibration", codec.decode_calibration, "time_ns", repeated=True),
    "revision": Kind("BiasRevision", codec.decode_revision, "time_ns"),
    "note": Kind("Note", codec.decode_note, "time_ns"),
}
SAMPLES = ("raw", "corrected")
#: what estimators say to each other: nothing of the ward's devices that is not said otherwise
PRIVATE = ("owned", "checkpoint")
PACKAGE = f"{pb.DESCRIPTOR.package}."
DESCRIPTORS = described(pb.DESCRIPTOR)


def topic(key: str) -> str:
    """MCAP topic of a key."""
    return key.split("/", 3)[3]


def log_ns(own_ns: int, now_ns: int) -> int:
    """Log time: the message's own, or the recorder's where the two are further apart than MAX_APART_NS."""
    return own_ns if abs(own_ns - now_ns) <= MAX_APART_NS else now_ns


def facts(key: str) -> dict[str, str]:
    """A channel's metadata: its whole key, and the ids in it."""
    place = keys.parse(key)
    return {"key": key, "ward": place.ward, **place.ids}
