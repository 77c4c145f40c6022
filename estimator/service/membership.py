"""Which estimators are alive, and whose each device is. Pure: `now` is monotonic seconds.

A device belongs to the live estimator with the highest rendezvous hash. That estimator takes the device under an epoch
above every epoch it has heard of, and keeps it until another estimator claims it under a higher one. Subscribers follow the
highest epoch.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from bridge.wire.messages import Holding, Owned
from estimator.service.ownership import BEYOND, epoch_after, owner

#: an estimator that says nothing for this long is taken for dead, s
LEASE_S = 1.5
#: nothing is taken for this long after the start beside others, an outage of the router or a pause of our own, s
HOLD_OFF_S = 2.0
MAX_PEERS = 64


@dataclass(slots=True)
class _Peer:
    """Another estimator: whether its token lives, when it spoke last, and what it claims, by part of its message."""

    heard_s: float
    token: bool = True
    parts: dict[int, dict[str, Holding]] = field(default_factory=dict)


class Membership:
    """What one estimator knows of all. peers: ids seen at the start; without any, nothing is held off."""

    def __init__(self, own: str, peers: Collection[str] = (), now: float = 0.0) -> None:
        self.own = own
        #: our devices, each with the epoch under which it was taken
        self.held: dict[str, int] = {}
        #: the highest epoch that was heard of or used
        self.highest = 0
        self._epoch = 0
        self._peers = {name: _Peer(now) for name in peers if name != own}
        self._ready_s = now + HOLD_OFF_S if self._peers else float("-inf")
        self._lost: dict[str, tuple[float, str]] = {}  # until when, s, a device is left to the one that took it
        self._owner = lru_cache(maxsize=1 << 14)(owner)
        #: the ids of all live estimators, our own among them
        self.members: tuple[str, ...] = tuple(sorted({own, *self._peers}))

    @property
    def alone(self) -> bool:
        """Whether no other estimator is alive."""
        return len(self.members) == 1

    def ready(self, now: float) -> bool:
        """Whether the hold-off is over."""
        return now >= self._ready_s

    def hold_off(self, now: float) -> None:
        """The router is gone, or we were paused: nobody is removed and nothing taken for a while."""
        self._ready_s = now + HOLD_OFF_S

    def excuse(self, seconds: float) -> None:
        """We could not listen for so long: that is no silence of the others."""
        for peer in self._peers.values():
            peer.heard_s += seconds

    def token(self, name: str, now: float, *, alive: bool) -> None:
        """The liveliness token of an estimator appeared or vanished."""
        peer = self._peers.get(name)
        if peer is not None:
            peer.token = alive
        elif alive and name != self.own and len(self._peers) < MAX_PEERS:
            # It is a member once it speaks: it holds off first, and nobody may wait for it meanwhile.
            self._peers[name] = _Peer(now - LEASE_S)

    def hear(self, *epochs: int) -> None:
        """Take note of epochs; impossibly high ones are ignored, since nobody could go above them."""
        self.highest = max(self.highest, *(epoch for epoch in epochs if epoch < BEYOND), 0)

    def said(self, owned: Owned, now: float) -> list[str]:
        """Another estimator's claims; returns those of our devices that it has under a higher epoch."""
        if owned.estimator == self.own:
            return []
        if owned.estimator not in self._peers and len(self._peers) < MAX_PEERS:
            self._peers[owned.estimator] = _Peer(now)
        if (peer := self._peers.get(owned.estimator)) is not None:
            peer.heard_s = now
            peer.parts[owned.part] = {holding.device: holding for holding in owned.holdings}
            for part in [part for part in peer.parts if part >= max(1, owned.parts)]:
                del peer.parts[part]
        self.hear(owned.epoch, *(holding.epoch for holding in owned.holdings))
        others = [h for h in owned.holdings if h.device in self.held and h.epoch < BEYOND]
        # Of equal epochs, which two ids can have, the one of the later id counts.
        return [h.device for h in others if (h.epoch, owned.estimator) > (self.held[h.device], self.own)]

    def look(self, now: float) -> tuple[list[str], list[str]]:
        """Update the members; returns who has come and who is gone since the last look."""
        living = {name for name, peer in self._peers.items() if peer.token and now - peer.heard_s < LEASE_S}
        before, there = set(self.members), {self.own, *living}
        if not self.ready(now):
            there |= before
        self.members = tuple(sorted(there))
        for name in [name for name, peer in self._peers.items() if not peer.token and name not in there]:
            del self._peers[name]
        return sorted(there - before), sorted(before - there)

    def owns(self, device: str) -> bool:
        """Whether a device belongs to us, by the estimators that are alive."""
        return self._owner(device, self.members) == self.own

    def wants(self, device: str, now: float) -> bool:
        """Whether a device is to be taken now: it is ours, and nobody is calibrating it who would lose the turns."""
        if device in self.held or not self.ready(now) or not self.owns(device):
            return False
        until_s, taker = self._lost.get(device, (now, ""))
        if now < until_s and taker in self.members:
            return False
        return not any(claim.busy for claim in self._claims(device))

    def take(self, device: str, now_ns: int) -> int:
        """Hold a device from now on; returns its epoch, one for all that are taken until another estimator takes something."""
        if not self._epoch or self.highest != self._epoch:
            self.highest = self._epoch = epoch_after(self.highest, now_ns, self.own)
        self._lost.pop(device, None)
        self.held[device] = self._epoch
        return self._epoch

    def lose(self, device: str, taker: str, now: float) -> None:
        """Another estimator has taken a device; it is not taken back from that one at once, or it would go to and fro."""
        self.held.pop(device, None)
        self._epoch = 0  # what is taken next is taken under another one, also where both were equal
        self._lost = {name: lost for name, lost in self._lost.items() if lost[0] > now}
        self._lost[device] = now + HOLD_OFF_S, taker

    def keep(self, devices: Collection[str]) -> None:
        """Hold no others than these any more."""
        self.held = {device: epoch for device, epoch in self.held.items() if device in devices}

    def answers(self, device: str) -> bool:
        """Whether we speak of a device, held or unknown."""
        if device in self.held or self.alone:
            return True
        return self.owns(device) and not any(True for _ in self._claims(device))

    def _claims(self, device: str) -> Iterator[Holding]:
        """What other live estimators said of a device."""
        for name in self.members:
            peer = self._peers.get(name)
            for part in list(peer.parts.values()) if peer is not None else ():
                if device in part:
                    yield part[device]
