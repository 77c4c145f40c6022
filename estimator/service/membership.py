"""Membership of estimators in a ward, and ownership of devices by rendezvous hashing. Pure: `now` is monotonic time, s.

A device belongs to the live estimator with the highest rendezvous hash. That estimator takes the device under a new
epoch: an ownership number, which rises with each takeover. The estimator keeps the device until another estimator
claims it under a higher epoch. Subscribers use the messages of the highest epoch.

Every estimator must reach the same answer by itself, although each may know different devices. So devices are not
counted, and are shared as evenly as chance allows (300 devices on three estimators: 100 ± 8 each).

An epoch is higher than every epoch received, so that an owner loses against its successor. Its last 16 bits are derived
from the estimator's id. The number before them is also later than the host time in ms, so that estimators that all
restarted continue above the epochs that subscribers know. Two estimators on opposite sides of a network partition take
one device under different epochs.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import blake2b
from zlib import crc32

from bridge.wire.messages import Holding, Owned
from bridge.wire.validation import MAX_EPOCH

#: an estimator silent for this long is considered dead, s
LEASE_S = 1.5
#: nothing is taken over for this long after a start beside others, a router outage or our own pause, s
HOLD_OFF_S = 2.0
#: most other estimators remembered
MAX_PEERS = 64

_OWN_BITS = 16
#: no clock and no number of takeovers reaches this epoch: a higher one is wrong, and could soon not be exceeded
BEYOND = MAX_EPOCH // 4


def owner(device: str, estimators: Collection[str]) -> str:
    """Return the id of the estimator that owns a device: the one with the highest rendezvous hash.

    estimators: at least one. When an estimator joins or leaves, only the devices of this estimator move.
    """
    return max(estimators, key=lambda name: (_weight(name, device), name))


@lru_cache(maxsize=1 << 16)
def _weight(estimator: str, device: str) -> int:
    # Python's own hash differs between processes. No id contains the separating byte.
    digest = blake2b(f"{estimator}\0{device}".encode(), digest_size=8).digest()
    return int.from_bytes(digest)


def epoch_after(highest: int, now_ns: int, estimator: str) -> int:
    """Compute the epoch for a takeover: higher than `highest`, and later than the time `now_ns` in whole ms.

    highest: highest epoch received. now_ns: host time, ns since the Unix epoch; may be wrong. estimator: id whose hash
    forms the last bits, so that two estimators hardly ever choose the same epoch.
    """
    turn = max(highest >> _OWN_BITS, now_ns // 1_000_000) + 1
    own_bits = crc32(estimator.encode()) & ((1 << _OWN_BITS) - 1)
    return min(turn << _OWN_BITS | own_bits, MAX_EPOCH)


@dataclass(slots=True)
class _Peer:
    """Another estimator: when it was last heard, whether its token lives, and its claims by message part."""

    heard_s: float
    token: bool = True
    parts: dict[int, dict[str, Holding]] = field(default_factory=dict)


class Membership:
    """View of all live estimators of a ward, as seen from one estimator, and the devices that this estimator holds.

    own: its id. peers: ids of other estimators seen at the start; without peers there is no hold-off (time in which no
    device is taken). now: monotonic time, s.
    """

    def __init__(self, own: str, peers: Collection[str] = (), now: float = 0.0) -> None:
        self.own = own
        #: our devices, each with the epoch under which it was taken
        self.held: dict[str, int] = {}
        #: the highest epoch heard of or used
        self.highest = 0
        self._epoch = 0
        self._peers = {name: _Peer(now) for name in peers if name != own}
        self._ready_s = now + HOLD_OFF_S if self._peers else float("-inf")
        self._lost: dict[str, tuple[float, str]] = {}  # by device: until when, s, it is left to the taker
        #: ids of all live estimators, including our own
        self.members: tuple[str, ...] = tuple(sorted({own, *self._peers}))

    @property
    def alone(self) -> bool:
        """True if no other estimator is alive."""
        return len(self.members) == 1

    def ready(self, now: float) -> bool:
        """Return whether devices may be taken now: no hold-off after a start, an outage or a pause is running.

        now: monotonic time, s.
        """
        return now >= self._ready_s

    def hold_off(self, now: float) -> None:
        """Start a hold-off after a router outage or a pause of this process.

        For HOLD_OFF_S seconds after `now`, monotonic time in s, no member is removed and no device taken.
        """
        self._ready_s = now + HOLD_OFF_S

    def excuse(self, seconds: float) -> None:
        """Postpone the time at which silent estimators count as dead.

        seconds: time in which no message could arrive, s.
        """
        for peer in self._peers.values():
            peer.heard_s += seconds

    def token(self, name: str, now: float, *, alive: bool) -> None:
        """Record that an estimator's liveliness token appeared on the bus (alive) or vanished.

        now: monotonic time, s.
        """
        peer = self._peers.get(name)
        if peer is not None:
            peer.token = alive
        elif alive and name != self.own and len(self._peers) < MAX_PEERS:
            # A new estimator becomes a member when it first speaks: until then it holds off, and nobody waits for it.
            self._peers[name] = _Peer(now - LEASE_S)

    def hear(self, *epochs: int) -> None:
        """Raise `highest` to the highest of these received epochs; epochs of BEYOND or more are wrong and ignored."""
        self.highest = max(self.highest, *(epoch for epoch in epochs if epoch < BEYOND), 0)

    def said(self, owned: Owned, now: float) -> list[str]:
        """Process an ownership message; return the devices that its sender has taken from this estimator.

        owned: lists the devices that the sender holds, with epochs. now: monotonic time, s.
        The sender has taken a device if its epoch is higher than the one under which this estimator holds the device.
        If the epochs are equal, the estimator id that sorts later wins.
        """
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
        # Two ids can produce equal epochs; then the claim of the later id counts.
        return [h.device for h in others if (h.epoch, owned.estimator) > (self.held[h.device], self.own)]

    def look(self, now: float) -> tuple[list[str], list[str]]:
        """Update `members`, the ids of live estimators; return the ids that appeared and the ids that disappeared.

        Both lists are sorted, and relative to the last call. now: monotonic time, s.
        """
        living = {name for name, peer in self._peers.items() if peer.token and now - peer.heard_s < LEASE_S}
        before, there = set(self.members), {self.own, *living}
        if not self.ready(now):
            there |= before
        self.members = tuple(sorted(there))
        for name in [name for name, peer in self._peers.items() if not peer.token and name not in there]:
            del self._peers[name]
        return sorted(there - before), sorted(before - there)

    def owns(self, device: str) -> bool:
        """Return whether the hash assigns a device to this estimator, among the live estimators.

        Another estimator may still hold the device.
        """
        return owner(device, self.members) == self.own

    def wants(self, device: str, now: float) -> bool:
        """Return whether this estimator should take a device now. now: monotonic time, s.

        All of these must hold:
        - The hash assigns the device to this estimator, which does not hold it yet.
        - No hold-off (time in which no device is taken) is running.
        - No other estimator is in a calibration of the device, since a takeover would lose its turns.
        - This estimator did not lose the device to a live estimator in the last HOLD_OFF_S seconds.
        """
        if device in self.held or not self.ready(now) or not self.owns(device):
            return False
        until_s, taker = self._lost.get(device, (now, ""))
        if now < until_s and taker in self.members:
            return False
        return not any(claim.busy for claim in self._claims(device))

    def take(self, device: str, now_ns: int) -> int:
        """Take ownership of a device; returns the epoch, which is higher than every one received.

        now_ns: host time, ns since the Unix epoch. Devices taken in a row share one epoch, until an epoch from another
        estimator arrives.
        """
        if not self._epoch or self.highest != self._epoch:
            self.highest = self._epoch = epoch_after(self.highest, now_ns, self.own)
        self._lost.pop(device, None)
        self.held[device] = self._epoch
        return self._epoch

    def lose(self, device: str, taker: str, now: float) -> None:
        """Give up a device to the estimator `taker`. now: monotonic time, s.

        The device is not taken back for HOLD_OFF_S seconds, so that it does not move to and fro.
        """
        self.held.pop(device, None)
        self._epoch = 0  # the next take uses a new epoch, also where both epochs were equal
        self._lost = {name: lost for name, lost in self._lost.items() if lost[0] > now}
        self._lost[device] = now + HOLD_OFF_S, taker

    def keep(self, devices: Collection[str]) -> None:
        """Give up all held devices except those with these ids."""
        self.held = {device: epoch for device, epoch in self.held.items() if device in devices}

    def answers(self, device: str) -> bool:
        """Return whether this estimator answers commands for a device.

        True if it holds the device, or if no other estimator is alive. Also True if the hash assigns the device to it
        and no other estimator holds the device.
        """
        if device in self.held or self.alone:
            return True
        return self.owns(device) and not any(True for _ in self._claims(device))

    def _claims(self, device: str) -> Iterator[Holding]:
        """Claims of other live estimators on a device."""
        for name in self.members:
            peer = self._peers.get(name)
            for part in list(peer.parts.values()) if peer is not None else ():
                if device in part:
                    yield part[device]
