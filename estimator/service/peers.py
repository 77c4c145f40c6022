"""The other estimators of the ward, over the bus: who is there, who has what, and what is kept to take over from them."""

import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from itertools import islice

from bridge.bus.contract import Bus, Message
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint, Holding, Move, Owned
from bridge.wire.refusal import Refusal, Tally
from estimator.client.decoder import Decoder
from estimator.service.cluster import Cluster, Taker
from estimator.service.device import Device
from estimator.service.interim import Taken
from estimator.service.replicas import Replicas, checkpoint_of
from estimator.service.roster import MAX_DEVICES
from estimator.service.silent import Silent
from estimator.service.standby import MOST, Standby

log = logging.getLogger(__name__)

#: how often it is said what is ours; where there is nobody to whom it matters, only for who looks
SAY_S, SAY_ALONE_S = 0.2, 1.0
#: a round that begins so long after the one before was held up; so is our line where nothing at all came for so long
HELD_UP_S = 0.5
#: devices that are taken over in one round: then it is those' turn that we have, and that come back first
TAKEN_AT_ONCE = 64
#: and more only once fewer than these wait for their turn: where names are made up there is no end of them
TAKEN_MOST = 1024
#: and of which what came meanwhile is handled in one: those that were ours before do not wait long for it
AT_ONCE = 4
#: how often it is looked whether there is a router, when no token has changed
_LOOK_S = 0.25
_MOVES, _WAITING = 8, 65536
#: so much of what was said is known as our own when it comes back
_SAID = 1024
#: messages that say to be ours and are not are counted under this
DOUBLE = "messages of another estimator with our id"


class Peers:
    """Used from the service's own thread but for `answers` and what the bus tells of tokens.

    peers: the ids of those that were found at the start.
    """

    def __init__(
        self,
        ward: str,
        own: str,
        data: Bus,
        control: Bus,
        now_ns: Callable[[], int],
        counts: Tally,
        peers: Collection[str],
    ) -> None:
        self.cluster = Cluster(own, peers, time.monotonic())
        self.replicas = Replicas(MAX_DEVICES)
        self._buses, self._now_ns, self._counts = (data, control), now_ns, counts
        self._standby, self._ours = Standby(MAX_DEVICES), Standby(MAX_DEVICES)
        #: whether there ever was another
        self.company = bool(self.cluster.members[1:])
        self._tokens: deque[tuple[str, bool]] = deque(maxlen=_WAITING)
        #: called on a thread of the bus when an estimator has come or is gone
        self.on_token: Callable[[], None] = lambda: None
        self._owned = Decoder[Owned]("ownership", codec.decode_owned)
        self._checkpoints = Decoder[Checkpoint]("checkpoint", codec.decode_checkpoint)
        self._own = keys.build(ward, "owned", estimator=own)
        self._said, self._mine = data.publisher(self._own), deque[int](maxlen=_SAID)
        self._heard = data.subscribe(keys.pattern(ward, "owned"))
        self._kept = data.subscribe(keys.pattern(ward, "checkpoint"), history=True)
        self._watch = control.watch_alive(keys.pattern(ward, "alive/estimator"), self._token)
        self._next_say = self._next_scan = self._next_look = self._next_tidy = 0.0
        self._looked, self._deaf_s = time.monotonic(), 0.0
        self._moves: deque[Move] = deque(maxlen=_MOVES)
        self._came, self._left, self._why = 0, Counter[str](), ""
        #: whether another spoke of a device that came
        self._again = False
        #: devices that were taken over, and what came of each that is still to be handled
        self._taken = dict[str, list[Message]]()
        self._came_meanwhile: list[Message] = []
        #: whether more of what is taken over now follows in the next round, and whether the last move is the begin of it
        self._more = self._taking = False
        self._newcomer = False
        self._calibrated: list[Checkpoint] = []
        self._load = 0.0
        self._load_since = time.monotonic(), time.process_time()

    def close(self) -> None:
        """Listen no more."""
        for thing in (self._watch, self._heard, self._kept, self._said):
            thing.close()

    @property
    def pressing(self) -> bool:
        """Whether there are more devices to be taken over at once, or to be handled that were."""
        return self._more or bool(self._taken)

    @property
    def waiting(self) -> int:
        """Devices that were taken over, and have no session yet."""
        return len(self._taken)

    def refused(self) -> dict[str, int]:
        """What was not understood or had no room, counted."""
        said = {
            f"{door.name} messages refused, {why}": n
            for door in (self._owned, self._checkpoints)
            for why, n in door.refused.as_dict().items()
        }
        return said | ({"messages of others' devices dropped": n} if (n := self._standby.dropped) else {})

    # ---- whose devices are --------------------------------------------------------------------------------------------

    def look(self, now: float, *, heard: bool) -> list[str]:
        """Hear what the others say, once a round; the devices of ours that are another's now. heard: whether samples came."""
        cluster = self.cluster
        came = self._heard.drain(512, 0.0)
        said = [message for message in came if message.key != self._own]
        if len(said) < len(came):
            self._look_for_double(came)
        self._excuse(now, heard=heard or bool(said))
        if self._tokens:
            self._next_look = now
        while self._tokens:
            self._changed(*self._tokens.popleft(), now)
        lost: dict[str, Taker] = {}
        for message in said:
            owned = self._owned.take(message)
            if owned is not None:
                self._hear(owned, lost, now)
        for message in self._kept.drain(4096, 0.0):
            checkpoint = self._checkpoints.take(message)
            if checkpoint is not None:
                cluster.hear(checkpoint.epoch)
                self.replicas.note(checkpoint)
                if checkpoint.calibration is not None and checkpoint.epoch < cluster.held.get(checkpoint.device, 0):
                    self._calibrated.append(checkpoint)
        if now >= self._next_look and not cluster.alone:
            self._next_look = now + _LOOK_S
            if not all(bus.connected for bus in self._buses):
                cluster.unreachable(now)
        self._notice(*cluster.look(now), now)
        for device, taker in lost.items():
            cluster.lose(device, taker, now)
            self._taken.pop(device, None)
            self._ours.move(device, self._standby, now)
        return list(lost)

    def _look_for_double(self, came: Sequence[Message]) -> None:
        """Two of one id that were started at once, or one that hung and was replaced: neither looks at the other."""
        foreign = sum(message.key == self._own and hash(message.payload) not in self._mine for message in came)
        if foreign and self._counts.add(DOUBLE, foreign) == foreign:
            log.error(
                "another estimator says to be %s, too, and both correct its devices: stop one, or give it another id and a store"
                " of its own (more is only counted)",
                self.cluster.own,
            )

    def _excuse(self, now: float, *, heard: bool) -> None:
        """Nobody is silent while we do not get round to listening, nor while nothing at all comes over our own line."""
        late_s, self._looked = now - self._looked, now
        if late_s > HELD_UP_S or self._deaf_s > HELD_UP_S:
            self.cluster.held_up(late_s, now)
        self._deaf_s = 0.0 if heard else self._deaf_s + late_s

    def _hear(self, owned: Owned, lost: dict[str, Taker], now: float) -> None:
        fresh = [device for device in self.cluster.said(owned, now) if device not in lost]
        lost |= dict.fromkeys(fresh, self.cluster.taker(owned.estimator))
        self._left[owned.estimator] += len(fresh)
        for h in owned.holdings:
            if h.device not in self.cluster.held:
                self._standby.done(h.device, h.boot, h.next, now, h.epoch)

    def _notice(self, came: list[str], gone: list[str], now: float) -> None:
        for name in came:
            log.info("estimator %s is here: devices are shared with it", name)
        for name in gone:
            log.warning("estimator %s is gone: its devices are taken over", name)
        if came or gone:
            self._newcomer |= bool(came)
            self._next_scan = self._next_say = now
            self._why = ", ".join([*(f"{name} has come" for name in came), *(f"{name} is gone" for name in gone)])

    def calibrated(self) -> list[Checkpoint]:
        """What those who had our devices before knew of them, calibrated, and said after we took them."""
        found, self._calibrated = self._calibrated, []
        return found

    def sift(self, messages: Sequence[Message], now: float) -> Sequence[Message]:
        """Of samples that came, those of our devices; the others are kept for a while."""
        cluster = self.cluster
        if not self.company:
            return messages
        ours: list[Message] = []
        for message in messages:
            try:
                device = keys.parse(message.key).device
            except Refusal:
                ours.append(message)  # the door refuses it, too, and counts it
                continue
            if device in cluster.held:
                if len(self._taken.get(device, ())) >= MOST:
                    ours += self._taken.pop(device)  # who sends that much is seen to as all are who do
                if (waiting := self._taken.get(device)) is None:
                    ours.append(message)
                else:
                    waiting.append(message)
                    self._came_meanwhile.append(message)
                self._ours.hold(device, message, now)
            elif self._standby.hold(device, message, now):
                self._next_scan = now  # it may be ours, and is said to be first
        return ours

    def taken_over(self, devices: dict[str, Device], silent: Silent, now: float) -> list[Taken]:
        """Some devices that are ours from now on, and are said to be; what came of them is to be handled as it is `turn`.

        The others follow in the next rounds. Those that send nothing are `silent`.
        """
        if now < self._next_scan:
            return []
        self._next_scan = now + SAY_ALONE_S
        if not self._more and now >= self._next_tidy:
            self._next_tidy = now + SAY_ALONE_S
            for kept in (self._standby, self._ours):
                kept.tidy(now)
        self.cluster.keep({*devices, *silent, *self._taken})
        for known in list(self.replicas) if self.cluster.settled(now) else ():
            if known.device not in self._standby and self.cluster.orphaned(known.device, known.epoch):
                silent.take(known, self._begin(known.device), self._now_ns())
        wants, waits_s = self.cluster.wants, self._standby.waits_s
        most = max(0, min(TAKEN_AT_ONCE, TAKEN_MOST - len(self._taken)))
        wanted = dict.fromkeys(islice((d for d in self._standby if wants(d, now, waits_s(d, now))), most))
        for h in self.cluster.claims() if wanted else ():
            if h.device in wanted:  # what came since its owner spoke last may be long past: a bridge's cache
                self._standby.done(h.device, h.boot, h.next, now, h.epoch)
        taken = [self._take(device, now) for device in wanted]
        self._more = 0 < most == len(taken)
        if self._more or not most:
            self._next_scan = now
        if taken:
            self._next_say = now
            # Before anything of them is: else we could die, and nobody would know the epoch.
            self.say(devices, now)
        elif self._taking or (not self._came and self.cluster.settled(now)):
            self._taking, self._why = False, ""  # what comes later has another reason
        return taken

    def next_in_line(self, before: Collection[str] = ()) -> set[str]:
        """Devices of others that are ours as soon as they are gone, and that could be gone on with at once.

        Also those that were so before, and send nothing now: they may come back at any time.
        """
        heard = {*self._standby, *before}
        return {device for device in heard if self.replicas.bridge(device) and self.cluster.near(device)}

    def meanwhile(self) -> list[Message]:
        """What came, since this was asked last, of those that were taken over and still wait for their turn."""
        came, self._came_meanwhile = self._came_meanwhile, []
        return came

    def turn(self) -> list[list[Message]]:
        """What came of some of those that were taken over, of each in its order, once no more are to be taken over."""
        if self._more:
            return []
        return [self._taken.pop(device) for device in list(islice(self._taken, AT_ONCE))]

    def epoch(self, device: str) -> int:
        """Since when a device is ours; it is from now on, if it was not."""
        return self.cluster.held.get(device) or self._begin(device)

    def back(self, device: str, message: Message, now: float) -> None:
        """A message of a device that has left us, and that nobody has looked at."""
        if not self._standby.has(device, message):
            self._standby.hold(device, message, now)

    def answers(self, device: str) -> bool:
        """Whether it is for us to answer a command; from any thread."""
        return self.cluster.answers(device)

    def _take(self, device: str, now: float) -> Taken:
        epoch, messages = self._begin(device), self._standby.move(device, self._ours, now)
        self._taken[device] = list(messages)  # and what comes meanwhile
        return Taken(device, epoch, messages)

    def _begin(self, device: str) -> int:
        self._came += 1
        self._again |= bool(self.replicas.bridge(device))
        return self.cluster.take(device, self._now_ns())

    def _token(self, key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
        self._tokens.append((key, alive))
        self.on_token()

    def _changed(self, key: str, alive: bool, now: float) -> None:  # noqa: FBT001
        try:
            name = keys.parse(key).ids["estimator"]
        except Refusal as refusal:
            self._counts.add(f"tokens refused, {refusal.reason}")
            return
        self.cluster.change(name, now, alive=alive)
        self.company |= alive and name != self.cluster.own

    # ---- what is said of ours ---------------------------------------------------------------------------------------

    def due(self, now: float) -> bool:
        """Whether it is time to say what is ours, or something was taken."""
        return now >= self._next_say or (self._came > 0 and not self.cluster.alone)

    def say(self, devices: dict[str, Device], now: float) -> None:
        """Say what is ours, if it is time to."""
        cluster = self.cluster
        if not self.due(now):
            return
        self._next_say = now + (SAY_ALONE_S if cluster.alone else SAY_S)
        time_ns = self._now_ns()
        self._moved(time_ns)
        self._measure(now)
        holdings = [_holding(name, epoch, devices.get(name)) for name, epoch in cluster.held.items()]
        most = codec.MAX_HOLDINGS
        parts = max(1, -(-len(holdings) // most))
        for part in range(parts):
            some = tuple(holdings[part * most : (part + 1) * most])
            owned = Owned(cluster.own, time_ns, cluster.highest, self._load, some, tuple(self._moves), part, parts)
            payload = codec.encode_owned(owned)
            self._mine.append(hash(payload))
            self._said.put(payload)
        if self._newcomer:
            self._newcomer = False
            for name in cluster.leaving():
                if name in devices:
                    self.tell(devices[name])

    def tell(self, device: Device) -> None:
        """Say what another would need of a device, where there is another; where there was one, we know better from now on."""
        alone = self.cluster.undisputed
        if alone and self.replicas.of(device.name) is None:
            return
        checkpoint = checkpoint_of(device, self._now_ns(), self.replicas.answers(device.name))
        if checkpoint is None:
            return
        if alone:
            self.replicas.note(checkpoint)
        else:
            device.say_checkpoint(codec.encode_checkpoint(checkpoint))

    def _moved(self, time_ns: int) -> None:
        if self._came:
            came, why = self._came, self._why or ("shared out anew" if self._again else "heard for the first time")
            if self._taking and self._moves and self._moves[-1].came:
                came += self._moves.pop().came
            self._moves.append(Move(time_ns, came, 0, why))
            self._came, self._taking, self._again = 0, self._more, False
            if not self._more:
                self._why = ""
        for name, n in self._left.items():
            if n:
                self._moves.append(Move(time_ns, 0, n, f"{name} has taken them"))
        self._left.clear()

    def _measure(self, now: float) -> None:
        since, spent = self._load_since
        if now - since >= SAY_ALONE_S:
            self._load = (time.process_time() - spent) / (now - since)
            self._load_since = now, time.process_time()


def _holding(name: str, epoch: int, device: Device | None) -> Holding:
    if device is None:
        return Holding(name, epoch, 0, 0)
    session = device.session
    busy = bool(session.learnt.turned or session.learnt.asked) and not device.left_out
    return Holding(name, epoch, session.boot or 0, session.sequence.next or 0, busy)
