"""Devices of one that is gone are taken over in portions, each said to be ours first, and handled in smaller ones."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from bridge.bus.contract import Message
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import Owned
from bridge.wire.refusal import Tally
from estimator.service.peers import AT_ONCE, TAKEN_AT_ONCE, Peers
from estimator.service.silent import Silent

WARD, DEVICES, ROUND_S = "w", 2 * TAKEN_AT_ONCE + AT_ONCE, 0.02


@dataclass
class Clock:
    now: float = 1000.0

    def monotonic(self) -> float:
        return self.now

    def process_time(self) -> float:
        return 0.0


@pytest.mark.parametrize("others", [("e2",), ("e2", "e3")])
def test_devices_are_taken_over_in_portions_each_said_first(
    monkeypatch: pytest.MonkeyPatch, others: tuple[str, ...]
) -> None:
    clock, broker = Clock(), MemoryBroker()
    monkeypatch.setattr("estimator.service.peers.time", clock)
    peers = Peers(WARD, "e1", MemoryBus(broker), MemoryBus(broker), lambda: 1, Tally(), others)
    silent = Silent(MemoryBus(broker), WARD, peers.replicas, lambda _: None)  # type: ignore[arg-type, return-value]
    heard = MemoryBus(broker).subscribe(keys.pattern(WARD, "owned"))
    e3 = MemoryBus(broker).publisher(keys.build(WARD, "owned", estimator="e3"))
    learnt = SimpleNamespace(turned=False, asked=False)
    session = SimpleNamespace(learnt=learnt, boot=1, sequence=SimpleNamespace(next=1))
    raw = [Message(keys.build(WARD, "raw", bridge="b", device=f"d{n}"), b"x") for n in range(DEVICES)]
    devices: dict[str, SimpleNamespace] = {}
    said: set[str] = set()
    at_once, portions = list[int](), list[int]()
    for n in range(300):
        clock.now += ROUND_S
        if "e3" in others and n % 10 == 0:  # e2 says nothing: it is gone
            e3.put(codec.encode_owned(Owned("e3", 1, 0, 0.0, (), (), 0, 1)))
        peers.look(clock.now, heard=True)
        over = peers.taken_over(devices, silent, clock.now)  # type: ignore[arg-type]
        queues = peers.turn()
        for message in heard.drain(1000, 0.0):
            owned = codec.decode_owned(message.key, message.payload)
            said |= {holding.device for holding in owned.holdings if owned.estimator == "e1"}
        taken = {keys.parse(queue[0].key).device for queue in queues}
        assert {one.device for one in over} <= said
        assert not over or len(over) == TAKEN_AT_ONCE or queues
        at_once += [len(over)] if over else []
        portions += [len(taken)] if taken else []
        devices |= dict.fromkeys(taken, SimpleNamespace(session=session, left_out=False))
        peers.sift(raw, clock.now)
        peers.say(devices, clock.now)  # type: ignore[arg-type]
    assert max(portions) == AT_ONCE
    assert AT_ONCE < max(at_once) <= TAKEN_AT_ONCE
    reasons = [move.reason for move in peers._moves]
    assert reasons == ["heard for the first time", "e2 is gone"]
    assert sum(move.came for move in peers._moves) == len(devices) == sum(portions)
    if "e3" not in others:
        assert len(devices) == DEVICES
