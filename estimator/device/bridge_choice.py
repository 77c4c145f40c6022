"""Which bridge a device is taken from, and whether a message continues a boot, begins one or is refused.

Pure: time is an argument. One bad message must not silence a device; a bad sender must not silence it for ever.
"""

from dataclasses import dataclass
from enum import Enum, auto

from bridge.wire.batches import MAX_SEQUENCE
from bridge.wire.validation import MAX_TIME_NS
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.samples.sample_buffer import Samples

#: a bridge keeps its devices this much longer than a device may be silent
OWNED_S = 1.0
#: a stream of which nothing could be taken for this long, so many batches in a row, is what the device now sends
PERSISTS_S, PERSISTS_BATCHES = 3.0, 5
#: no device is faster; a cache may hold this much that was said in no time
FASTEST_HZ, CACHE_S = 1e4, 60.0
#: of samples closer to each other than these so many are taken; what waits for its device's time to go on would have no end
CROWD, CROWD_HZ = 4096, 2e5
#: device time that may pass between the ends of two batches and be looked at no further
PLAIN_S = 60.0
#: no batch is of a longer time: each second of it is work of its own
BATCH_S = 600.0
#: device time may run this much ahead of what the clock's rate says: a replay's rate is only learnt after a while
CLOCK_SLACK = 10.0
NAMED_BRIDGES = 8
#: samples of a device that another bridge sends are counted under this and its name
ELSEWHERE = "also from "


class Ruling(Enum):
    """What to do with a batch."""

    TAKE = auto()
    #: the device has started anew: begin its boot
    BOOT = auto()
    #: not from this device, or not now: count it, and the message is done with
    RANGE = auto()
    #: late or repeated: the session counts it
    LATE = auto()
    #: a leap that has come to stay
    JUMP = auto()
    #: a boot of the past goes on
    RETURN = auto()
    #: numbers known long ago come again and again: another power-up under an old name
    REPEAT = auto()


#: a boot begins with the batch
BEGINS = frozenset({Ruling.BOOT, Ruling.RETURN, Ruling.REPEAT})
#: the batch is counted, and nothing else is done with it
REFUSED = frozenset({Ruling.LATE, Ruling.RANGE})


@dataclass(slots=True)
class Mark:
    """The end of what was taken last: number and device time, s, when it was received, and heard."""

    sequence: int
    device_s: float
    receive_ns: int
    heard_s: float


class BridgeChoice:
    """One device's. `owner` is the bridge it is heard from; heard_s arguments are seconds of any steady clock."""

    def __init__(self, silence_s: float) -> None:
        self.owner = ""
        self._owned_s = silence_s + OWNED_S
        self._heard_s = float("-inf")
        self._others: dict[str, float] = {}  # bridges that are refused, and when each was heard last
        self._latest: Mark | None = None
        self._booted_ns = 0  # when the first batch of the boot that is taken was received
        self._refused, self._refused_since_s, self._refused_last_s = 0, 0.0, 0.0
        self._refused_next = 0, 0  # boot and number that the next of them has to have, or a later one
        self._room = float(CROWD)

    def owns(self, bridge: str, heard_s: float) -> bool:
        """Whether this bridge is the one that is listened to; it becomes so when the other one is not heard any more."""
        if bridge != self.owner:
            if heard_s - self._heard_s <= self._owned_s:
                return False
            self.owner = bridge
        self._heard_s = heard_s
        return True

    def hold(self, heard_s: float) -> None:
        """Nobody can be heard now: the owner stays the owner."""
        self._heard_s = heard_s

    def go_on(self, heard_ns: int) -> None:
        """The boot that goes on was heard at this host time."""
        self._booted_ns = heard_ns

    def label(self, bridge: str, heard_s: float) -> str:
        """Under what another bridge's samples, that came now, are counted; a bounded number of names."""
        if bridge in self._others or len(self._others) < NAMED_BRIDGES:
            self._others[bridge] = heard_s
        return f"{ELSEWHERE}{bridge if bridge in self._others else 'others'}"

    def refused(self, now: float) -> tuple[str, ...]:
        """The bridges that send it now beside its owner."""
        return tuple(
            bridge for bridge, at in self._others.items() if bridge != self.owner and now - at <= self._owned_s
        )

    def judge(self, batch: Samples, sequence: SequenceNumbers, heard_s: float) -> Ruling:
        """What to do with a batch of the owner's."""
        if self._goes_on(batch, sequence):
            self._took(batch, heard_s)
            return Ruling.TAKE
        ruling = self._judge(batch, sequence, heard_s)
        if ruling is not Ruling.LATE and self._crowds(batch):
            return Ruling.RANGE
        if ruling in REFUSED:
            if not (_publishable(batch) and self._persists(batch, heard_s) and self._is_news(batch, sequence)):
                return ruling
            if ruling is Ruling.RANGE:
                ruling = Ruling.JUMP
            elif batch.boot != sequence.boot and sequence.follows(batch):
                ruling = Ruling.RETURN
            else:
                ruling = Ruling.REPEAT
        if ruling in BEGINS:
            self._booted_ns = batch.receive_time_ns
        self._took(batch, heard_s)
        return ruling

    def _took(self, batch: Samples, heard_s: float) -> None:
        self._refused = 0
        self._latest = Mark(batch.sequence + batch.n, batch.last_s, batch.receive_time_ns, heard_s)
        self._booted_ns = min(self._booted_ns, batch.receive_time_ns)  # its host's clock may be set back

    def _goes_on(self, batch: Samples, sequence: SequenceNumbers) -> bool:
        """Whether it plainly follows what was taken last, which is all that most do: then nothing else needs to be looked at."""
        latest, n = self._latest, batch.n
        if latest is None or batch.boot != sequence.boot or not sequence.next == batch.sequence == latest.sequence:
            return False
        passed_s = batch.last_s - latest.device_s
        if not (batch.first_s > latest.device_s and n / CROWD_HZ <= passed_s < PLAIN_S):
            return False
        return batch.sequence + n <= MAX_SEQUENCE

    def _judge(self, batch: Samples, sequence: SequenceNumbers, heard_s: float) -> Ruling:
        boots = sequence.is_new_boot(batch.boot)
        if boots and sequence.boot is not None and self._older(batch):
            return Ruling.LATE
        if not boots and (batch.boot != sequence.boot or not sequence.follows(batch)):
            return Ruling.LATE
        if not _publishable(batch) or self._leaps(batch, heard_s, anew=boots):
            return Ruling.RANGE
        return Ruling.BOOT if boots else Ruling.TAKE

    def _leaps(self, batch: Samples, heard_s: float, *, anew: bool) -> bool:
        begin_s, end_s = batch.first_s, batch.last_s
        mark = Mark(batch.sequence, begin_s, batch.receive_time_ns, heard_s)
        if self._latest is not None and not anew:
            mark = self._latest
        # A host's clock may be set back between two batches; ours cannot.
        passed_s = max((batch.receive_time_ns - mark.receive_ns) * 1e-9, heard_s - mark.heard_s) + CACHE_S
        device_s = passed_s / min(1.0, batch.clock_rate)
        return batch.sequence - mark.sequence > FASTEST_HZ * device_s or end_s - mark.device_s > CLOCK_SLACK * device_s

    def _crowds(self, batch: Samples) -> bool:
        """Whether its samples are closer together, or further apart, than those of any device."""
        begin_s, end_s = batch.first_s, batch.last_s
        since_s = begin_s if self._latest is None else min(begin_s, self._latest.device_s)
        room = min(CROWD, self._room + (end_s - since_s) * CROWD_HZ) - batch.n
        if room < 0 or end_s - begin_s > BATCH_S:
            return True
        self._room = room
        return False

    def _older(self, batch: Samples) -> bool:
        """Whether a boot that was never heard is one before the present one: its samples were received earlier.

        Or its host's clock was set back; then nothing else comes of the device, and it persists.
        """
        return batch.receive_time_ns < self._booted_ns

    def _is_news(self, batch: Samples, sequence: SequenceNumbers) -> bool:
        """Whether what persists was received after all that was taken: else somebody plays a recording of it.

        A boot that was never heard may be older: there is no recording of it that we know of, and a host's clock may be set back.
        """
        latest_ns = self._latest.receive_ns if self._latest is not None else 0
        return sequence.is_new_boot(batch.boot) or batch.receive_time_ns > latest_ns

    def _persists(self, batch: Samples, heard_s: float) -> bool:
        """Whether batches were refused for long enough, each going on where the one before ended: no shuffled recording."""
        goes_on = (batch.boot, batch.sequence) >= self._refused_next and batch.boot == self._refused_next[0]
        if not self._refused or heard_s - self._refused_last_s > PERSISTS_S or not goes_on:
            self._refused, self._refused_since_s = 0, heard_s
        self._refused += 1
        self._refused_last_s = heard_s
        self._refused_next = batch.boot, batch.sequence + batch.n
        return self._refused >= PERSISTS_BATCHES and heard_s - self._refused_since_s >= PERSISTS_S


def _publishable(batch: Samples) -> bool:
    """Whether its last sample, too, can be said on the wire: a corrected batch may be cut anywhere."""
    return batch.last_ns < MAX_TIME_NS and batch.sequence + batch.n <= MAX_SEQUENCE
