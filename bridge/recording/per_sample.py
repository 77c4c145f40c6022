"""Copies of the samples beside the batches, one ROS 2 message each: programs that plot show no arrays over time.

Readers of recordings pass the copies over, by the metadata COPY of their channels.
"""

from collections.abc import Iterable, Iterator
from math import inf
from typing import NamedTuple, TypeVar

from bridge.recording.mcap_writer import ROS2, McapWriter
from bridge.recording.message_kinds import Said
from bridge.recording.sequence_tracker import SequenceTracker
from bridge.ros import messages
from bridge.ros.imu_rows import ImuJoin, ImuRows, reading_rows
from bridge.wire.messages import CorrectedBatch, OrientationBatch, SampleBatch

#: name in a channel's metadata: the kind of the batches whose samples the channel repeats
COPY = "copy_of"
Batch = TypeVar("Batch", SampleBatch, CorrectedBatch)
_TOPICS = {"corrected": "imu", "raw": "imu_raw"}


class Copy(NamedTuple):
    """One sample as a sensor_msgs/msg/Imu message, for its channel. facts: the channel's metadata.

    time_ns: host time, ns since the Unix epoch. payload: CDR bytes.
    """

    topic: str
    facts: dict[str, str]
    time_ns: int
    payload: bytes


class PerSample:
    """Makes one ROS 2 message, a Copy, per sample of a ward.

    Readings have the topic `/WARD/DEVICE/imu_raw`, corrected samples `/WARD/DEVICE/imu`.
    A sample that arrives again is not repeated. `now_s` is seconds of a steady clock.
    """

    def __init__(self, ward: str) -> None:
        self._ward = ward
        self._join = ImuJoin(patient=True)
        self._encoders: dict[str, messages.ImuEncoder] = {}
        self._known: dict[tuple[str, str], tuple[int, SequenceTracker]] = {}  # the boot that sends now

    def take(self, said: Said, now_s: float) -> Iterator[Copy]:
        """Take a decoded message; yield the copies of samples that are ready.

        A corrected sample waits for its orientation.
        """
        if isinstance(said, SampleBatch):
            yield from self._join_and_copy(said, now_s)
            if (new := self._new("raw", said)) is not None:
                yield from self._copies("raw", [reading_rows(new)])
        elif isinstance(said, CorrectedBatch):
            if (of := self._new("corrected", said)) is not None:
                yield from self._join_and_copy(of, now_s)
        elif isinstance(said, OrientationBatch):
            yield from self._join_and_copy(said, now_s)

    def due(self, now_s: float = inf) -> Iterator[Copy]:
        """Yield the copies of corrected samples that have waited long enough for further messages.

        Without a time, all of them.
        """
        return self._copies("corrected", self._join.due(now_s))

    def _join_and_copy(self, said: SampleBatch | CorrectedBatch | OrientationBatch, now_s: float) -> Iterator[Copy]:
        return self._copies("corrected", self._join.take(said, now_s))

    def _new(self, what: str, batch: Batch) -> Batch | None:
        boot, tracker = self._known.get((what, batch.device), (-1, None))
        if tracker is None or boot != batch.boot:
            tracker = SequenceTracker()
            self._known[what, batch.device] = batch.boot, tracker
        skip = tracker.follow(batch).skip
        if skip == len(batch):
            return None
        return batch.after(skip) if skip else batch

    def _copies(self, what: str, found: Iterable[ImuRows]) -> Iterator[Copy]:
        for rows in found:
            device = rows.device
            encoder = self._encoders.get(device) or self._encoders.setdefault(device, messages.ImuEncoder(device))
            topic, facts = f"/{self._ward}/{device}/{_TOPICS[what]}", {"device": device, COPY: what}
            for time_ns, payload in encoder.encode(rows):
                yield Copy(topic, facts, time_ns, payload)


class CopyChannels:
    """Writes copies of samples to an MCAP file, and adds the channel of a topic at its first copy."""

    def __init__(self, writer: McapWriter) -> None:
        self._writer = writer
        self._channels: dict[str, int] = {}

    def put(self, copy: Copy) -> None:
        """Write a copy with its sample time as log time. Raises OSError."""
        channel = self._channels.get(copy.topic)
        if channel is None:
            channel = self._writer.channel(
                copy.topic, messages.IMU, messages.definition(messages.IMU), copy.facts, encoding=ROS2
            )
            self._channels[copy.topic] = channel
        self._writer.add(channel, copy.time_ns, copy.time_ns, copy.payload)
