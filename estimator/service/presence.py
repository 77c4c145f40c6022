"""Presence of devices and bridges by liveliness tokens on the bus. A token is a hint; only samples are proof.

Tokens travel apart from samples and may overtake them or come late. So the end of one boot's token says nothing about
another boot, and a new token does not make a lost device live. Changes arrive on a thread of the bus and are processed
by the service's own thread.
"""

from collections import deque
from typing import NamedTuple

from bridge.reasons.codes import Code, Sentences
from bridge.wire import keys
from bridge.wire.refusal import Refusal, Tally

#: time a token must be dead and its bridge alive to mean anything, s: a router change kills and revives all tokens
SETTLED_S = 0.5
#: most tokens remembered, and most changes that wait
MAX_TOKENS = 65536


class _Token(NamedTuple):
    alive: bool
    since_s: float


class Presence:
    """Record of the device boots and bridges that have a liveliness token on the bus."""

    def __init__(self, counts: Tally) -> None:
        self._counts = counts
        self._waiting: deque[tuple[str, bool]] = deque(maxlen=MAX_TOKENS)
        #: by device and boot, or bridge; the token that changed longest ago comes first
        self._tokens: dict[tuple[str, ...], _Token] = {}
        self._forgot = False

    def change(self, key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
        """Queue the appearance (alive) or end of a token; called on a thread of the bus. key: bus key of the token."""
        self._waiting.append((key, alive))

    def note(self, now: float) -> None:
        """Process the token changes that `change` has queued. now: monotonic time, s."""
        while self._waiting:
            name, alive = self._waiting.popleft()
            try:
                ids = tuple(keys.parse(name).ids.values())
            except Refusal as refusal:
                self._counts.add(f"tokens refused, {refusal.reason}")
                continue
            self._tokens.pop(ids, None)
            self._tokens[ids] = _Token(alive, now)
            if len(self._tokens) > MAX_TOKENS:
                del self._tokens[next(iter(self._tokens))]

    def forget(self) -> None:
        """Forget all tokens when the router is gone.

        Tokens vanish with the router, which says nothing about the devices.
        """
        self._forgot = True
        self._waiting.clear()
        self._tokens.clear()

    def gone(self, device: str, boot: int, bridge: str, now: float) -> bool:
        """Return whether a live bridge withdrew the token of exactly this boot at least SETTLED_S seconds ago.

        now: monotonic time, s.
        """
        token, there = self._of(device, boot), self._tokens.get((bridge,))
        if token is None or token.alive or there is None or not there.alive:
            return False
        return now - max(token.since_s, there.since_s) >= SETTLED_S

    def heard(self, device: str, boot: int, bridge: str) -> bool:
        """Return whether a live bridge reports by token that it receives exactly this boot."""
        token = self._of(device, boot)
        return token is not None and token.alive and self.alive(bridge)

    def alive(self, bridge: str) -> bool:
        """Return whether a bridge is alive: its token is on the bus."""
        there = self._tokens.get((bridge,))
        return there is not None and there.alive

    def why(self, device: str, boot: int, bridge: str) -> Sentences:
        """Return the reasons, known from tokens, why nothing arrives from a device in this boot.

        Empty if there are none.
        """
        there, token = self._tokens.get((bridge,)), self._of(device, boot)
        if there is not None and not there.alive:
            return (Code.BRIDGE_GONE(bridge=bridge),)
        if token is not None and not token.alive:
            return (Code.DEVICE_UNHEARD(bridge=bridge),)
        if there is None and self._forgot:
            return (Code.BRIDGE_NOT_BACK(bridge=bridge),)
        return ()

    def _of(self, device: str, boot: int) -> _Token | None:
        return self._tokens.get((device, keys.boot_id(boot)))
