"""Admission control for the sample messages of one device: accepts or refuses each batch, and detects new boots.

Only samples from one bridge are used at a time. A single bad message must not silence a device, and a faulty sender
must not silence it for ever. Pure: time is an argument.
"""

from dataclasses import dataclass
from enum import Enum, auto

from bridge.wire.batches import MAX_SEQUENCE
from bridge.wire.refusal import Reason
from bridge.wire.validation import MAX_TIME_NS
from estimator.device.sequence_numbers import SequenceNumbers
from estimator.samples.sample_buffer import Samples

#: s beyond the permitted silence of a device for which its bridge stays the owner
OWNED_S = 1.0
#: a refused stream that continues for this long, s, and for this many batches is accepted as what the device now sends
PERSISTS_S, PERSISTS_BATCHES = 3.0, 5
#: Hz, no device samples faster; s of samples that a cache may deliver at once
FASTEST_HZ, CACHE_S = 1e4, 60.0
#: batches denser than CROWD_HZ are accepted up to CROWD samples; more would fill memory while device time stands still
CROWD, CROWD_HZ = 4096, 2e5
#: s of device time between the ends of two batches, below which no further check is needed
PLAIN_S = 60.0
#: s, longest accepted batch: each second of device time costs work of its own
BATCH_S = 600.0
#: factor by which device time may run ahead of host time: a replay's rate becomes known only after a while
CLOCK_SLACK = 10.0
NAMED_BRIDGES = 8
#: prefix of the counter for samples of a device that another bridge sends; the bridge's name follows
ELSEWHERE = "also from "


class Ruling(Enum):
    """Ruling on a batch of samples: accept the batch, begin a boot with it, or refuse it.

    TAKE: accept, since the batch continues the boot. JUMP: accept after a leap in sequence number or device time that
    has persisted.
    BOOT: begin a new boot. RETURN: go back to an earlier boot. REPEAT: begin a new power-up under a known boot id.
    LATE: refuse and count late or repeated samples. RANGE: refuse and count implausible device times or sequence
    numbers.
    """

    TAKE = auto()
    #: the device has restarted: begin its boot
    BOOT = auto()
    #: implausible times or numbers: count the batch, do nothing else
    RANGE = auto()
    #: late or repeated: the counters of the session tell which
    LATE = auto()
    #: leap in number or time that has persisted
    JUMP = auto()
    #: an earlier boot continues
    RETURN = auto()
    #: known numbers keep coming under a known boot id: another power-up
    REPEAT = auto()


#: rulings with which a boot begins
BEGINS = frozenset({Ruling.BOOT, Ruling.RETURN, Ruling.REPEAT})
#: rulings after which the batch is only counted
REFUSED = frozenset({Ruling.LATE, Ruling.RANGE})


@dataclass(slots=True)
class Mark:
    """End of the last accepted batch.

    sequence: sequence number expected next. device_s: device time of the last sample, s. receive_ns: host time of receipt
    at the bridge, ns since the Unix epoch. heard_s: time of arrival at the estimator, s of a steady clock.
    """

    sequence: int
    device_s: float
    receive_ns: int
    heard_s: float


class Admission:
    """Admission control for one device: takes samples only from the owner, the one bridge whose samples are used.

    Batches of old boots and implausible batches are refused. A refused stream that continues for some seconds is
    accepted.

    silence_s: permitted silence of the device, s. Another bridge can replace an owner that was silent for more than
    silence_s + OWNED_S seconds.
    `owner`: name of the owner. `sequence`: counters of accepted samples, shared with the session.
    """

    def __init__(self, silence_s: float) -> None:
        self.owner, self.sequence = "", SequenceNumbers()
        #: boot of the latest samples refused as old, and when they came, s
        self.outdated = 0, float("-inf")
        #: of a failed session: boot, next sequence number, and receive time of its last samples, ns
        self._came_to = 0, 0, 0
        self._owned_s = silence_s + OWNED_S
        self._heard_s = float("-inf")
        self._others: dict[str, float] = {}  # refused bridges, with the time each was last heard, s
        self._latest: Mark | None = None
        self._booted_ns = 0  # receive time of the current boot's first batch
        self._refused, self._refused_since_s, self._refused_last_s = 0, 0.0, 0.0
        self._refused_next = 0, 0  # boot and least sequence number by which the next refused batch continues the last
        self._room = float(CROWD)

    def owns(self, bridge: str, heard_s: float) -> bool:
        """Return whether a bridge owns the device, when its message arrives; make it the owner if the owner is silent.

        heard_s: arrival time of the message, s of a steady clock. An owner counts as silent after silence_s + OWNED_S
        seconds without a message. A message of the owner starts this time anew.
        """
        if bridge != self.owner:
            if heard_s - self._heard_s <= self._owned_s:
                return False
            self.owner = bridge
        self._heard_s = heard_s
        return True

    def hold(self, heard_s: float) -> None:
        """Restart the owner's silence timer while no bridge can be received at all.

        heard_s: present time, s of a steady clock; the owner's silence is measured from then on.
        """
        self._heard_s = heard_s

    def go_on(self, heard_ns: int) -> None:
        """Set the time of the last sample of a boot that continues from a saved session.

        heard_ns: host time of receipt of this sample, ns since the Unix epoch. A batch of an unknown boot that was
        received earlier counts as older and is refused.
        """
        self._booted_ns = heard_ns

    def label(self, bridge: str, heard_s: float) -> str:
        """Return the counter's name for samples from a bridge that is not the owner; record when this bridge sent them.

        heard_s: arrival time of the samples, s of a steady clock. Each of the first NAMED_BRIDGES bridges has its own
        counter; all others share one.
        """
        if bridge in self._others or len(self._others) < NAMED_BRIDGES:
            self._others[bridge] = heard_s
        return f"{ELSEWHERE}{bridge if bridge in self._others else 'others'}"

    def refused(self, now: float) -> tuple[str, ...]:
        """Return the ids of bridges other than the owner whose samples of this device were refused recently.

        now: present time, s of a steady clock. Recently: in the last silence_s + OWNED_S seconds.
        """
        return tuple(
            bridge for bridge, at in self._others.items() if bridge != self.owner and now - at <= self._owned_s
        )

    def restart(self, came: int, out: int, last_ns: int) -> SequenceNumbers:
        """Replace the sequence counters after a session has failed, and return the new counters.

        came, out: numbers of samples received and published so far. last_ns: host time of receipt, ns since the Unix
        epoch, of the last samples that the failed session took. Repeats of these samples are refused.
        """
        before = self.sequence
        if before.boot is not None:
            self._came_to = before.boot, before.next or 0, last_ns
        self.sequence = before.anew(came, out)
        return self.sequence

    def judge(self, batch: Samples, heard_s: float) -> Ruling:
        """Return the ruling on a batch from the owner; a refused batch is counted.

        heard_s: arrival time of the batch, s of a steady clock.
        """
        sequence = self.sequence
        if self._goes_on(batch):
            self._took(batch, heard_s)
            return Ruling.TAKE
        if sequence.boot is None and self._known(batch):
            sequence.refuse(batch, Reason.DUPLICATE)
            return Ruling.LATE
        ruling = self._judge_all(batch, heard_s)
        if ruling is Ruling.LATE:
            self.outdated = batch.boot, heard_s
            sequence.fresh(batch)  # counts the batch
        elif ruling is Ruling.RANGE:
            sequence.refuse(batch, Reason.RANGE)
        elif ruling is Ruling.JUMP:
            sequence.jump(batch)
        return ruling

    def _judge_all(self, batch: Samples, heard_s: float) -> Ruling:
        """Rule on a batch, also on what persists after it was refused."""
        sequence, ruling = self.sequence, self._judge(batch, heard_s)
        if ruling is not Ruling.LATE and self._crowds(batch):
            return Ruling.RANGE
        if ruling in REFUSED:
            if not (_publishable(batch) and self._persists(batch, heard_s) and self._is_news(batch)):
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

    def _known(self, batch: Samples) -> bool:
        """Return whether a failed session had already taken all samples of a batch."""
        boot, following, received_ns = self._came_to
        return batch.boot == boot and batch.sequence + batch.n <= following and batch.receive_time_ns <= received_ns

    def _took(self, batch: Samples, heard_s: float) -> None:
        self._refused = 0
        self._latest = Mark(batch.sequence + batch.n, batch.last_s, batch.receive_time_ns, heard_s)
        self._booted_ns = min(self._booted_ns, batch.receive_time_ns)  # the host's clock may be set back

    def _goes_on(self, batch: Samples) -> bool:
        """Return whether a batch plainly continues the last one, as most do; then no other check is needed."""
        latest, sequence, n = self._latest, self.sequence, batch.n
        if latest is None or batch.boot != sequence.boot or not sequence.next == batch.sequence == latest.sequence:
            return False
        passed_s = batch.last_s - latest.device_s
        if not (batch.first_s > latest.device_s and n / CROWD_HZ <= passed_s < PLAIN_S):
            return False
        return batch.sequence + n <= MAX_SEQUENCE

    def _judge(self, batch: Samples, heard_s: float) -> Ruling:
        sequence = self.sequence
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
        # The sender's clock may be set back between two batches; our steady clock cannot.
        passed_s = max((batch.receive_time_ns - mark.receive_ns) * 1e-9, heard_s - mark.heard_s) + CACHE_S
        device_s = passed_s / min(1.0, batch.clock_rate)
        return batch.sequence - mark.sequence > FASTEST_HZ * device_s or end_s - mark.device_s > CLOCK_SLACK * device_s

    def _crowds(self, batch: Samples) -> bool:
        """Return whether the samples are denser than any device's, or the batch is too long."""
        begin_s, end_s = batch.first_s, batch.last_s
        since_s = begin_s if self._latest is None else min(begin_s, self._latest.device_s)
        room = min(CROWD, self._room + (end_s - since_s) * CROWD_HZ) - batch.n
        if room < 0 or end_s - begin_s > BATCH_S:
            return True
        self._room = room
        return False

    def _older(self, batch: Samples) -> bool:
        """Return whether a boot never heard before is older than the present one: its samples were received earlier.

        The cause may also be a host clock set back; then only such batches arrive, and `_persists` accepts them.
        """
        return batch.receive_time_ns < self._booted_ns

    def _is_news(self, batch: Samples) -> bool:
        """Return whether a persistent stream was received after all accepted samples; else it is a replayed recording.

        A boot never heard before may be older: no recording of it is known, and a host's clock may be set back.
        """
        latest_ns = self._latest.receive_ns if self._latest is not None else 0
        return self.sequence.is_new_boot(batch.boot) or batch.receive_time_ns > latest_ns

    def _persists(self, batch: Samples, heard_s: float) -> bool:
        """Return whether refused batches have come for long enough, each after the end of the last.

        A shuffled recording does not send its batches in this order.
        """
        goes_on = (batch.boot, batch.sequence) >= self._refused_next and batch.boot == self._refused_next[0]
        if not self._refused or heard_s - self._refused_last_s > PERSISTS_S or not goes_on:
            self._refused, self._refused_since_s = 0, heard_s
        self._refused += 1
        self._refused_last_s = heard_s
        self._refused_next = batch.boot, batch.sequence + batch.n
        return self._refused >= PERSISTS_BATCHES and heard_s - self._refused_since_s >= PERSISTS_S


def _publishable(batch: Samples) -> bool:
    """Return whether the last sample's time and number fit the wire format: a corrected batch may be cut anywhere."""
    return batch.last_ns < MAX_TIME_NS and batch.sequence + batch.n <= MAX_SEQUENCE
