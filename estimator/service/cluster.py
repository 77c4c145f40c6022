"""Cooperation of a ward's estimators over the bus: live estimators, ownership of devices, checkpoints for takeover."""

import logging
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TypeVar

from bridge.bus.contract import Bus, Message
from bridge.reasons.codes import Code, Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import Alert, Checkpoint, Holding, Owned
from bridge.wire.refusal import Refusal, Tally
from estimator.service.checkpoints import Checkpoints, checkpoint_of
from estimator.service.device import Device
from estimator.service.device_roster import MAX_DEVICES
from estimator.service.membership import BEYOND, LEASE_S, Membership
from estimator.service.moves import Moves
from estimator.service.replay_log import ReplayLog

log = logging.getLogger(__name__)
T = TypeVar("T")

#: interval between ownership messages, with other estimators and alone, s
SAY_S, SAY_ALONE_S = 0.25, 1.0
#: most devices taken over in one round, so that samples of devices already held do not wait for hundreds
TAKEN_AT_ONCE = 16
#: a round that starts this long after the last was delayed here; the others' silence is then excused, s
HELD_UP_S = 0.5
_TOKENS, _SAID = 65536, 64
#: messages of another estimator with this estimator's id are counted under this name
DOUBLE = "messages of another estimator with the same id"


class Cluster:
    """Membership, ownership and checkpoints of the ward's estimators, as seen from one of them.

    own: id of this estimator. now_ns: the host's clock, ns since the Unix epoch. counts: the ward's counts of refused
    and lost messages. peers: ids of other estimators seen at the start.
    Runs on the service's own thread, except the handler of liveliness tokens.
    """

    def __init__(
        self,
        ward: str,
        own: str,
        bus: Bus,
        now_ns: Callable[[], int],
        counts: Tally,
        peers: Collection[str],
    ) -> None:
        now = time.monotonic()
        self.membership = Membership(own, peers, now)
        self.replicas = Checkpoints(MAX_DEVICES)
        self._bus, self._now_ns, self._counts = bus, now_ns, counts
        #: recent messages of all devices, kept beside other estimators
        self.replay = ReplayLog()
        #: whether another estimator was ever seen
        self.company = not self.membership.alone
        self._tokens: deque[tuple[str, bool]] = deque(maxlen=_TOKENS)
        self._own_key = keys.build(ward, "owned", estimator=own)
        self._said, self._mine = bus.publisher(self._own_key), deque[int](maxlen=_SAID)
        self._heard = bus.subscribe(keys.pattern(ward, "owned"), prompt=False)
        self._kept = bus.subscribe(keys.pattern(ward, "checkpoint"), history=True, prompt=False)
        self._watch = bus.watch_alive(
            keys.pattern(ward, "alive/estimator"), lambda key, alive: self._tokens.append((key, alive))
        )
        self._looked, self._deaf_s, self._next_say, self._scan = now, 0.0, 0.0, True
        self._moves = Moves(now_ns)
        self._why: Sentences = ()
        #: as seen in the last look: whether another estimator appeared, which needs checkpoints of our devices ...
        self.came = False
        #: ... and checkpoints with a calibration that former owners sent of our devices after we took them
        self.calibrated: list[Checkpoint] = []
        #: standing alerts of this estimator itself
        self.alerts: tuple[Alert, ...] = ()
        self._load, self._load_since = 0.0, (now, time.process_time())

    def close(self) -> None:
        """Close the subscriptions, the publisher and the liveliness watch."""
        for thing in (self._watch, self._heard, self._kept, self._said):
            thing.close()

    # ---- what the others say ----------------------------------------------------------------------------------------

    def look(self, now: float, *, heard: bool) -> list[str]:
        """Process the other estimators' messages; return the ids of devices that another estimator took.

        Called once a round of the run loop. now: monotonic time, s. heard: whether samples arrived in this round.
        While neither samples nor other estimators' messages arrive, no estimator counts as dead for its silence.
        Sets `came`: whether another estimator appeared.
        Sets `calibrated`: checkpoints of devices held here that contain a calibration and were sent by an earlier owner
        of the device.
        """
        membership, self.came, self.calibrated = self.membership, False, []
        said = self._heard.drain(512, 0.0)
        self._excuse(now, heard=heard or any(message.key != self._own_key for message in said))
        if self._tokens and self.company and not self._bus.connected:
            membership.hold_off(now)  # all tokens vanished with the router
        while self._tokens:
            self._changed(*self._tokens.popleft(), now)
        lost: dict[str, str] = {}
        for message in said:
            if message.key == self._own_key:
                self._look_for_double(message)
            elif (owned := self._read("ownership", codec.decode_owned, message)) is not None:
                self.company |= owned.estimator != membership.own
                lost |= dict.fromkeys(membership.said(owned, now), owned.estimator)
        for message in self._kept.drain(4096, 0.0):
            if (checkpoint := self._read("checkpoint", codec.decode_checkpoint, message)) is not None:
                self._note(checkpoint)
        self._notice(*membership.look(now))
        for device, taker in lost.items():
            membership.lose(device, taker, now)
        for name in sorted(set(lost.values())):
            left = sum(taker == name for taker in lost.values())
            self._moves.left(left, name)
        return list(lost)

    def look_round(self, now: float, devices: Collection[str]) -> None:
        """Give up all held devices except `devices`, and schedule a search for unowned devices; called once a second.

        now: monotonic time, s. The next `take` does the search. If other estimators exist and no router is connected,
        no device is taken for HOLD_OFF_S seconds.
        """
        self.membership.keep(devices)
        if self.company and not self._bus.connected:  # alone, no other estimator takes what this one leaves
            self.membership.hold_off(now)
        self._scan = True

    def _read(self, what: str, decode: Callable[[str, bytes], T], message: Message) -> T | None:
        """Decode another estimator's message of a kind `what`; None where it is refused and counted."""
        try:
            return decode(*message)
        except Refusal as refusal:
            if self._counts.add(f"{what} messages refused, {refusal.reason}") == 1:
                log.warning(
                    "one %s message was refused: %s (further ones of this kind are counted, not logged)", what, refusal
                )
            return None

    def _note(self, checkpoint: Checkpoint) -> None:
        if checkpoint.epoch >= BEYOND:  # no later epoch could ever replace it
            self._counts.add("checkpoint messages refused, epoch")
            return
        self.membership.hear(checkpoint.epoch)
        self.replicas.note(checkpoint)
        if checkpoint.calibration is not None and checkpoint.epoch < self.membership.held.get(checkpoint.device, 0):
            self.calibrated.append(checkpoint)

    def _excuse(self, now: float, *, heard: bool) -> None:
        """Extend the others' lease for time in which we did not listen, or nothing arrived on our own line."""
        late_s, self._looked = now - self._looked, now
        if late_s > HELD_UP_S or self._deaf_s > HELD_UP_S:
            self.membership.excuse(late_s)
        if late_s > LEASE_S and self.company:
            self.membership.hold_off(now)
        self._deaf_s = 0.0 if heard else self._deaf_s + late_s

    def _look_for_double(self, message: Message) -> None:
        if hash(message.payload) in self._mine or self._counts.add(DOUBLE) > 1:
            return
        log.error(
            "another estimator also has the id %s, and both correct the same devices: stop one of them, or give it another"
            " id and its own store (further messages are counted, not logged)",
            self.membership.own,
        )

    def _changed(self, key: str, alive: bool, now: float) -> None:  # noqa: FBT001
        try:
            name = keys.parse(key).ids["estimator"]
        except Refusal as refusal:
            self._counts.add(f"tokens refused, {refusal.reason}")
            return
        self.membership.token(name, now, alive=alive)
        if alive and name != self.membership.own:
            self.company = self.came = True

    def _notice(self, came: list[str], gone: list[str]) -> None:
        for name in came:
            log.info("estimator %s joined the ward and takes a share of the devices", name)
        for name in gone:
            log.warning("estimator %s is gone: the other estimators take over its devices", name)
        if came or gone:
            self._scan, self._next_say = True, 0.0
            self._why = (
                *(Code.ESTIMATOR_CAME(estimator=name) for name in came),
                *(Code.ESTIMATOR_GONE(estimator=name) for name in gone),
            )

    # ---- which devices are ours ---------------------------------------------------------------------------------------

    def take(self, others: Mapping[str, Sequence[Message]], now: float) -> dict[str, list[Message]]:
        """Take ownership of the devices that this estimator should own now; return their sample messages by device.

        others: messages of this round by device, of devices that this estimator does not hold. now: monotonic time, s.
        Without other estimators, the returned messages are those in `others`. Otherwise they are the device's messages
        of the last REPLAY_S seconds, and at most TAKEN_AT_ONCE devices are taken per call.
        """
        self.replay.tidy(now)
        wanted = [device for device in others if self.membership.wants(device, now)]
        if self._scan and self.membership.ready(now):
            known = {known.device for known in self.replicas} | self.replay.devices()
            wanted = list(dict.fromkeys([*wanted, *(d for d in sorted(known) if self.membership.wants(d, now))]))
            self._scan = False
            self._why = self._why if wanted else ()
        if not wanted:
            return {}
        # Alone, no other estimator holds messages of a device not yet taken.
        taken = wanted[:TAKEN_AT_ONCE] if self.company else wanted
        self._scan |= len(wanted) > len(taken)
        for device in taken:
            self.membership.take(device, self._now_ns())
        again = any(self.replicas.of(device) is not None for device in taken)
        self._moved(len(taken), self._why or (Code.SHARED_ANEW() if again else Code.HEARD_FIRST(),))
        return self.replay.of(taken) if self.company else {device: list(others.get(device, ())) for device in taken}

    def epoch(self, device: str) -> int:
        """Return the epoch under which this estimator holds a device.

        The epoch is the number of the ownership; it rises with each takeover. Takes ownership of the device if it is
        not held yet.
        """
        return self.membership.held.get(device) or self.membership.take(device, self._now_ns())

    def answers(self, key: keys.Key) -> bool:
        """Return whether this estimator must answer a command, given the command's bus key.

        It answers for the devices that it holds, and for acknowledgements of its own alerts. It also answers for a
        device that no estimator holds, if the hash assigns the device to it.
        """
        if key.ids["verb"] == "acknowledge" and key.device in self.membership.members:
            return key.device == self.membership.own
        return self.membership.answers(key.device)

    # ---- what is said of ours -----------------------------------------------------------------------------------------

    def say(self, devices: dict[str, Device], now: float) -> None:
        """Publish which devices this estimator owns, if the next message is due.

        One message is due every SAY_S seconds; without other estimators, every SAY_ALONE_S seconds.
        devices: devices of this estimator by id. now: monotonic time, s. During a hold-off (no takeovers after a start
        or an outage) nothing is published, so that no other estimator waits for this one.
        """
        membership = self.membership
        if now < self._next_say or not membership.ready(now):
            return
        self._next_say = now + (SAY_ALONE_S if membership.alone else SAY_S)
        self._measure(now)
        holdings = [_holding(name, epoch, devices.get(name)) for name, epoch in membership.held.items()]
        most = codec.MAX_HOLDINGS
        parts = max(1, -(-len(holdings) // most))
        for part in range(parts):
            some = tuple(holdings[part * most : (part + 1) * most])
            payload = codec.encode_owned(
                Owned(
                    membership.own,
                    self._now_ns(),
                    membership.highest,
                    self._load,
                    some,
                    tuple(self._moves.latest),
                    part,
                    parts,
                    () if part else self.alerts,
                )
            )
            self._mine.append(hash(payload))
            self._said.put(payload)

    def tell(self, device: Device) -> None:
        """Publish a device's checkpoint for the other estimators.

        Without other estimators nothing is published. The checkpoint is then kept in memory, if another estimator held
        the device before.
        """
        alone = not self.company
        if alone and self.replicas.of(device.name) is None:
            return
        checkpoint = checkpoint_of(device, self._now_ns(), self.replicas.answers(device.name))
        if checkpoint is None:
            return
        if alone:
            self.replicas.note(checkpoint)
        else:
            device.say("checkpoint", codec.encode_checkpoint(checkpoint))

    def _moved(self, came: int, why: Sentences) -> None:
        self._moves.came(came, why)
        self._next_say = 0.0  # publish ownership before any message under the new epoch, which is unknown to the others
        if not self._scan:
            self._why = ()

    def _measure(self, now: float) -> None:
        since, spent = self._load_since
        if now - since >= SAY_ALONE_S:
            self._load = (time.process_time() - spent) / (now - since)
            self._load_since = now, time.process_time()


def _holding(name: str, epoch: int, device: Device | None) -> Holding:
    if device is None:
        return Holding(name, epoch, 0, 0)
    session = device.session
    busy = bool(session.learnt.turned or session.learnt.asked)
    return Holding(name, epoch, session.boot or 0, session.sequence.next or 0, busy)
