"""Writer of a copy of each sample as one ROS 2 message, for programs that cannot plot the arrays of a batch over time.

Readers of recordings skip these copies, which they recognise by the metadata COPY of the channel.
"""

from collections.abc import Iterable, Iterator
from math import inf
from typing import NamedTuple

from bridge.recording.mcap_writer import ROS2, McapWriter
from bridge.recording.message_kinds import Said
from bridge.recording.sequence_tracker import SequenceTracker
from bridge.ros import messages
from bridge.ros.imu_rows import ImuJoin, ImuRows, reading_rows
from bridge.wire.messages import CorrectedBatch, OrientationBatch, SampleBatch

#: name in a channel's metadata: the kind of the batches whose samples the channel repeats
COPY = "copy_of"
_TOPICS = {"corrected": "imu", "raw": "imu_raw"}


class Copy(NamedTuple):
    """Copy of one sample as a sensor_msgs/msg/Imu message, with the topic of its channel.

    facts: metadata of the channel. time_ns: host time, ns since the Unix epoch. payload: CDR bytes.
    """

    topic: str
    facts: dict[str, str]
    time_ns: int
    payload: bytes


class PerSample:
    """Converter of a ward's batches to one ROS 2 message (a Copy) per sample.

    Readings have the topic `/WARD/DEVICE/imu_raw`, corrected samples `/WARD/DEVICE/imu`. A sample that arrives twice is
    converted once. ward: id of the ward.
    """

    def __init__(self, ward: str) -> None:
        self._ward = ward
        self._join = ImuJoin(patient=True)
        self._encoders: dict[str, messages.ImuEncoder] = {}
        self._known: dict[tuple[type, str], tuple[int, SequenceTracker]] = {}  # the boot that sends now

    def take(self, said: Said, now_s: float) -> Iterator[Copy]:
        """Process a decoded message; yields the copies of samples that are ready.

        A corrected sample waits for its acceleration and orientation, at most 0.5 s.
        said: the message. now_s: time of a steady clock, s.
        """
        new = self._new(said) if isinstance(said, SampleBatch | CorrectedBatch) else None
        joined = new if isinstance(said, CorrectedBatch) else said
        if isinstance(joined, SampleBatch | CorrectedBatch | OrientationBatch):
            yield from self._copies("corrected", self._join.take(joined, now_s))
        if isinstance(new, SampleBatch):
            yield from self._copies("raw", [reading_rows(new)])

    def due(self, now_s: float = inf) -> Iterator[Copy]:
        """Yield the copies of corrected samples that have waited 0.5 s for their acceleration and orientation.

        now_s: time of a steady clock, s; by default infinite, which yields all waiting samples.
        """
        return self._copies("corrected", self._join.due(now_s))

    def _new(self, batch: SampleBatch | CorrectedBatch) -> SampleBatch | CorrectedBatch | None:
        """Return the samples of a batch that have not come before; None if there are none."""
        kind = type(batch)
        known = self._known.get((kind, batch.device))
        if known is None or known[0] != batch.boot:
            known = self._known[kind, batch.device] = batch.boot, SequenceTracker()
        skip = known[1].follow(batch).skip
        return batch.after(skip) if skip < len(batch) else None

    def _copies(self, what: str, found: Iterable[ImuRows]) -> Iterator[Copy]:
        for rows in found:
            device = rows.device
            encoder = self._encoders.get(device) or self._encoders.setdefault(device, messages.ImuEncoder(device))
            topic, facts = f"/{self._ward}/{device}/{_TOPICS[what]}", {"device": device, COPY: what}
            for time_ns, payload in encoder.encode(rows):
                yield Copy(topic, facts, time_ns, payload)


def write_copies(writer: McapWriter, copies: Iterable[Copy]) -> None:
    """Write copies of samples to an MCAP file; the log time is the sample time. Raises OSError if the write fails."""
    for copy in copies:
        definition = messages.definition(messages.IMU)
        channel = writer.channel(copy.topic, messages.IMU, definition, copy.facts, encoding=ROS2)
        writer.add(channel, copy.time_ns, copy.time_ns, copy.payload)
