"""Presence of devices and bridges by liveliness tokens: a hint, kept per boot. Only samples are proof.

Tokens travel apart from samples and may overtake them or come late. So the death of one boot's token says nothing of
another boot, and a birth revives no device. Changes arrive on a thread of the bus and are processed by the service's
own.
"""

from collections import deque
from dataclasses import dataclass

from bridge.reasons.codes import Code, Sentences
from bridge.wire import keys
from bridge.wire.refusal import Refusal, Tally

#: time a token must be dead and its bridge alive to mean anything, s: a router change kills and revives all tokens
SETTLED_S = 0.5
MAX_NAMES, MAX_BOOTS, _MAX_WAITING = 8192, 8, 65536


@dataclass(frozen=True, slots=True)
class _Token:
    alive: bool
    since_s: float


#: the latest tokens by name; the one that changed longest ago comes first
_Tokens = dict[str, _Token]


def _note(tokens: _Tokens, name: str, token: _Token, room: int) -> None:
    """Note a token; beyond `room` names the one that changed longest ago is dropped."""
    tokens.pop(name, None)
    while len(tokens) >= room:
        del tokens[next(iter(tokens))]
    tokens[name] = token


class Presence:
    """Tokens of devices' boots and of bridges; `now` is monotonic seconds."""

    def __init__(self, counts: Tally) -> None:
        self._counts = counts
        self._waiting: deque[tuple[str, bool]] = deque(maxlen=_MAX_WAITING)
        self._bridges: _Tokens = {}
        self._devices: dict[str, _Tokens] = {}
        self._forgot = False

    def change(self, key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
        """Queue the birth or death of a token; called on a thread of the bus."""
        self._waiting.append((key, alive))

    def note(self, now: float) -> None:
        """Process the queued changes."""
        while self._waiting:
            name, alive = self._waiting.popleft()
            try:
                key = keys.parse(name)
            except Refusal as refusal:
                self._counts.add(f"tokens refused, {refusal.reason}")
                continue
            token = _Token(alive, now)
            if key.what == "alive/bridge":
                _note(self._bridges, key.ids["bridge"], token, MAX_NAMES)
            elif key.what == "alive/device":
                while key.device not in self._devices and len(self._devices) >= MAX_NAMES:
                    del self._devices[next(iter(self._devices))]
                _note(self._devices.setdefault(key.device, {}), key.ids["boot"], token, MAX_BOOTS)

    def forget(self) -> None:
        """Forget all tokens: they vanish with the router, which says nothing about devices."""
        self._forgot = True
        self._waiting.clear()
        self._bridges.clear()
        self._devices.clear()

    def gone(self, device: str, boot: int, bridge: str, now: float) -> bool:
        """Whether a live bridge has withdrawn the token of exactly this boot."""
        token, there = self._boot(device, boot), self._bridges.get(bridge)
        return (
            token is not None
            and there is not None
            and not token.alive
            and there.alive
            and now - max(token.since_s, there.since_s) >= SETTLED_S
        )

    def heard(self, device: str, boot: int, bridge: str) -> bool:
        """Whether a live bridge states that it hears exactly this boot."""
        token, there = self._boot(device, boot), self._bridges.get(bridge)
        return token is not None and there is not None and token.alive and there.alive

    def alive(self, bridge: str) -> bool:
        """Whether a bridge is alive."""
        there = self._bridges.get(bridge)
        return there is not None and there.alive

    def why(self, device: str, boot: int, bridge: str) -> Sentences:
        """Known reasons why nothing arrives from a device; empty if there are none."""
        there, token = self._bridges.get(bridge), self._boot(device, boot)
        if there is not None and not there.alive:
            return (Code.BRIDGE_GONE(bridge=bridge),)
        if token is not None and not token.alive:
            return (Code.DEVICE_UNHEARD(bridge=bridge),)
        if there is None and self._forgot:
            return (Code.BRIDGE_NOT_BACK(bridge=bridge),)
        return ()

    def _boot(self, device: str, boot: int) -> _Token | None:
        return self._devices.get(device, {}).get(keys.boot_id(boot))
