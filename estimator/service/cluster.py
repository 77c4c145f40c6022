"""Which devices are ours, among several estimators, as one of them knows it. Pure: `now` is monotonic seconds.

An estimator takes a device when it is the owner of those that are alive, and keeps it until it hears another say that it has it,
under a higher epoch: so nothing stops while a device moves, and of two that have it one always gives way.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from math import isnan, nan
from typing import NamedTuple

from bridge.wire.messages import Holding, Owned
from estimator.service.epochs import BEYOND, OWN, epoch_after, own_bits
from estimator.service.ownership import owner

#: more than a ward has
MAX_PEERS = 64
#: devices whose owner is asked for again and again, as long as the same are alive
_ASKED = 1 << 14
#: what is left of a pause with each word that follows: half after 70, 14 s
_FADES = 0.99


@dataclass(frozen=True, slots=True)
class ClusterKnobs:
    """Seconds."""

    #: who starts looks round for so long
    settle_s: float = 1.0
    #: where the router was away: until everybody has had the time to come back, nobody is taken for gone
    return_s: float = 2.0
    #: who still reads what was said before waits for this much longer, and no longer than that in all
    behind_s: float = 0.3
    most_s: float = 15.0
    #: one whose connection lives and that says nothing for this long hangs; of one that spoke with longer pauses lately, over a
    #: bad line or because it has too much to do, for so many times as long as those, and at most
    hangs_s: float = 1.0
    pauses: float = 3.0
    hangs_most_s: float = 2.5
    #: as long of one that was not there before, for so long: on a busy machine loading still keeps it from speaking
    fresh_s: float = 8.0
    #: a device that another has under a higher epoch, and that we think is ours, is not taken before; twice as long each time
    #: that ours are taken again, until it has been calm: over a bad line they would go to and fro
    retry_s: float = 3.0
    retry_most_s: float = 48.0
    calm_s: float = 120.0
    #: where who took it has ended it is taken at once, unless it has come to that so often: a line that breaks looks the same
    at_once_s: float = 12.0
    #: but after so long where who has it does nothing with what comes of it here: its line carries what it says, and it hears
    #: nothing of the device. Then it is the next one's if that has it who should. Sooner than what came meanwhile is kept no more
    stands_s: float = 6.0
    #: a device that is being calibrated is left to who does it, for so long; where that one says nothing, for `hangs_most_s`
    busy_s: float = 600.0


class Taker(NamedTuple):
    """An estimator that took something from us, and since when it is there; NaN where we know no such one."""

    name: str
    since_s: float


class _Lost(NamedTuple):
    """A device that was taken from us: when, not taken back before, and by whom."""

    at_s: float
    until_s: float
    taker: Taker


@dataclass(slots=True)
class _Peer:
    heard_s: float
    since_s: float
    born_s: float
    said_s: float = float("-inf")
    alive: bool = True
    pause_s: float = 0.0
    parts: dict[int, dict[str, Holding]] = field(default_factory=dict)  # by device
    busy: dict[int, frozenset[str]] = field(default_factory=dict)  # devices, by part


class Cluster:
    """peers: the others that are known to be there at the start; without any, nobody is waited for."""

    def __init__(
        self, own: str, peers: Collection[str] = (), now: float = 0.0, knobs: ClusterKnobs | None = None
    ) -> None:
        self.own, self.knobs = own, knobs or ClusterKnobs()
        #: our devices, each with the epoch of our turn
        self.held: dict[str, int] = {}
        #: the highest epoch that was heard of, or used
        self.highest = 0
        self._turn = 0
        self._peers = {name: _Peer(now, now, now) for name in peers if name != own}
        self._settled_s = now + self.knobs.settle_s if self._peers else float("-inf")
        self._settled_by_s = now + self.knobs.most_s
        self._slept_s = float("-inf")
        #: what was said before is no proof that nobody else has a device
        self._woke_s = now
        self._lost: dict[str, _Lost] = {}
        self._retry_s, self._robbed_s = self.knobs.retry_s, float("-inf")
        self._spared: dict[str, float] = {}
        self._owner = lru_cache(maxsize=_ASKED)(owner)
        #: all estimators that are taken for alive, ourselves among them
        self.members: tuple[str, ...] = tuple(sorted({own, *self._peers}))

    @property
    def alone(self) -> bool:
        """Whether all devices are ours."""
        return len(self.members) == 1

    @property
    def undisputed(self) -> bool:
        """Whether nobody says to have any of them."""
        return self.alone and not self._lost

    def settled(self, now: float) -> bool:
        """Whether it is known who is there."""
        return now >= self._settled_s

    def change(self, name: str, now: float, *, alive: bool) -> None:
        """An estimator's token was born or has died."""
        if name == self.own:
            return
        if alive and name not in self._peers and len(self._peers) >= MAX_PEERS:
            return
        peer = self._peers.setdefault(name, _Peer(now, now, now))
        if alive and not peer.alive:
            peer.since_s = peer.born_s = now
        peer.alive, peer.heard_s = alive, now

    def unreachable(self, now: float) -> None:
        """There is no router now, and what became of the others is not known: it stays as it is."""
        self._woke_s = now
        self._settled_s, self._settled_by_s = now + self.knobs.return_s, now + self.knobs.most_s

    def behind(self, now: float) -> None:
        """There is more to be read than we got round to: who takes a device now would go on with what is long past."""
        if not self.settled(now):
            self._woke_s = now
            self._settled_s = max(self._settled_s, min(now + self.knobs.behind_s, self._settled_by_s))

    def held_up(self, seconds: float, now: float) -> None:
        """We did not get round to listening for so long: nobody's silence.

        Who slept for longer than it would wait for another has much to read first, not all of it came: it waits as at the start.
        Its router may have dropped it meanwhile, and with that line all tokens die, perhaps before it is seen to be gone.
        """
        for peer in self._peers.values():
            peer.heard_s += seconds
            if seconds > self.knobs.hangs_s:
                peer.since_s = peer.heard_s
        if seconds > self.knobs.hangs_s:
            if now - seconds - self._slept_s > self.knobs.most_s:  # who sleeps again and again has to go on some time
                self._settled_by_s = now + self.knobs.most_s
            self._slept_s = self._woke_s = now
            self._settled_s = max(self._settled_s, min(now + self.knobs.return_s, self._settled_by_s))

    def look(self, now: float) -> tuple[list[str], list[str]]:
        """Who has come, and who is gone, since the last look."""
        there = {self.own}
        for name, peer in list(self._peers.items()):
            if peer.alive and now - peer.heard_s <= self._patience_s(peer, now):
                there.add(name)
            elif self.settled(now) and not peer.alive:
                del self._peers[name]
        before = set(self.members)
        if not self.settled(now):
            there |= before
        if there == before:
            return [], []
        self.members = tuple(sorted(there))
        return sorted(there - before), sorted(before - there)

    def _patience_s(self, peer: _Peer, now: float) -> float:
        if now - peer.since_s < self.knobs.fresh_s:
            return self.knobs.hangs_most_s
        return min(max(self.knobs.hangs_s, self.knobs.pauses * peer.pause_s), self.knobs.hangs_most_s)

    def hear(self, *epochs: int) -> None:
        """Of turns that there were; of one that cannot have been it is not known how to go above it, and it is passed over."""
        self.highest = max(self.highest, *(epoch for epoch in epochs if epoch < BEYOND), 0)

    def said(self, owned: Owned, now: float) -> list[str]:
        """What another says to have; our devices that it has taken."""
        if owned.estimator == self.own:
            return []
        peer = self._peers.get(owned.estimator)
        if peer is not None:
            peer.pause_s = max(now - peer.heard_s, _FADES * peer.pause_s)
            peer.heard_s = now
            peer.parts[owned.part] = {h.device: h for h in owned.holdings}
            peer.busy[owned.part] = frozenset(h.device for h in owned.holdings if h.busy)
            for part in [part for part in peer.parts if part >= owned.parts]:
                del peer.parts[part], peer.busy[part]
            if owned.part + 1 >= owned.parts and len(peer.parts) >= owned.parts:  # all of it
                peer.said_s = now
        self.hear(owned.epoch, *(h.epoch for h in owned.holdings))
        return [h.device for h in owned.holdings if BEYOND > h.epoch > self.held.get(h.device, h.epoch)]

    def wants(self, device: str, now: float, waits_s: float = 0.0) -> bool:
        """Whether a device that is not ours is to be taken now; who has it has done nothing with what came of it for so long."""
        if self._owner(device, self.members) != self.own and not self._steps_in(device, waits_s):
            return False
        if not self.settled(now) and not self._nobodys(device):
            return False
        lost = self._lost.get(device)
        if lost is not None and self._is_left(device, lost, waits_s, now):
            return False
        self._lost.pop(device, None)
        return not self._busy(device, now)

    def _is_left(self, device: str, lost: _Lost, waits_s: float, now: float) -> bool:
        """Whether what was taken from us stays with who took it: not where that one has ended, or does nothing with it."""
        if now >= lost.until_s or min(waits_s, now - lost.at_s) >= self.knobs.stands_s:
            return False
        ended = not isnan(lost.taker.since_s) and self.taker(lost.taker.name) != lost.taker
        return not (ended and self._retry_s <= self.knobs.at_once_s and not self._claimed(device))

    def _nobodys(self, device: str) -> bool:
        """Whether all others have told what they have since we came to know too little of that, and it is not among it.

        Who begins, on a busy machine, is held up again and again: a device that is switched on meanwhile need not wait.
        """
        others = [self._peers.get(name) for name in self.members if name != self.own]
        since_s = self._woke_s + self.knobs.behind_s
        told = bool(others) and all(peer is not None and peer.said_s > since_s for peer in others)
        return told and not self._claimed(device)

    def _steps_in(self, device: str, waits_s: float) -> bool:
        """Whether the one that should have a device hears nothing of it, and we are the next."""
        if waits_s < self.knobs.stands_s:
            return False
        return self._next(device)

    def _next(self, device: str) -> bool:
        first = self._owner(device, self.members)
        others = tuple(name for name in self.members if name != first)
        return bool(others) and self._owner(device, others) == self.own

    def near(self, device: str) -> bool:
        """Whether a device that another has is ours as soon as that one is gone."""
        return device not in self.held and (self._owner(device, self.members) == self.own or self._next(device))

    def _busy(self, device: str, now: float) -> bool:
        """Whether another is about to calibrate it, and lives."""
        living = (p for p in self._peers.values() if p.alive and now - p.heard_s <= self.knobs.hangs_most_s)
        if not any(device in busy for peer in living for busy in peer.busy.values()):
            self._spared.pop(device, None)
            return False
        return now - self._spared.setdefault(device, now) < self.knobs.busy_s

    def take(self, device: str, now_ns: int) -> int:
        """A device is ours from now on: the epoch of our turn, the same for all until another has had one."""
        if not self._turn or self.highest != self._turn:
            self.highest = self._turn = epoch_after(self.highest, now_ns, self.own)
        self.held[device] = self._turn
        self._spared.pop(device, None)
        return self._turn

    def taker(self, name: str) -> Taker:
        """Who takes what is ours now under this name."""
        peer = self._peers.get(name)
        return Taker(name, nan if peer is None else peer.born_s)

    def lose(self, device: str, taker: Taker, now: float) -> None:
        """Another has it."""
        self.held.pop(device, None)
        if self._owner(device, self.members) == self.own:
            self._lost[device] = _Lost(now, now + self._wait_s(now), taker)

    def _wait_s(self, now: float) -> float:
        since_s = now - self._robbed_s
        if since_s > self.knobs.retry_s:  # else it is the same time still
            again = since_s < self.knobs.calm_s
            self._retry_s = min(2 * self._retry_s, self.knobs.retry_most_s) if again else self.knobs.retry_s
            self._robbed_s = now
        return self._retry_s

    def keep(self, devices: Collection[str]) -> None:
        """Of our devices there are these."""
        self.held = {device: epoch for device, epoch in self.held.items() if device in devices}

    def leaving(self) -> list[str]:
        """Our devices that are to be another's, and are ours until it says so."""
        return [] if self.alone else [device for device in self.held if self._owner(device, self.members) != self.own]

    def answers(self, device: str) -> bool:
        """Whether it is for us to speak of a device: it is ours, or would be, and nobody else has it. From any thread."""
        if device in self.held or self.alone:
            return True
        return self._owner(device, self.members) == self.own and not self._claimed(device)

    def orphaned(self, device: str, epoch: int) -> bool:
        """Whether a device of which another spoke last, under this epoch, is nobody's now, and ours to speak of."""
        ours = device in self.held or epoch & OWN == own_bits(self.own)
        return not ours and self._owner(device, self.members) == self.own and self.answers(device)

    def claims(self) -> Iterator[Holding]:
        """What the others said last to have, of those that are taken for alive."""
        for part in self._parts():
            yield from part.values()

    def _claimed(self, device: str) -> bool:
        return any(device in part for part in self._parts())

    def _parts(self) -> Iterator[dict[str, Holding]]:
        for name in self.members:
            peer = self._peers.get(name)
            yield from list(peer.parts.values()) if peer is not None else ()
