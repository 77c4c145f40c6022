"""Traffic that must change nothing: under wildcards, with others' ids, forged, and an hour recorded and played again."""

import hashlib
import pickle
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, DeviceInfo, SampleBatch, State
from tests.estimator.served import BRIDGE, WARD, Served
from tests.estimator.stream import Stream, info

#: messages of one device in a round of 0.1 s
EACH_ROUND, ROUND_S = 36, 0.1


def named(batches: Iterable[SampleBatch], device: str) -> list[SampleBatch]:
    return [replace(batch, device=device) for batch in batches]


def message(batch: SampleBatch, bridge: str = BRIDGE) -> Message:
    return Message(keys.build(WARD, "raw", bridge=bridge, device=batch.device), codec.encode_samples(batch))


def wildcards(batch: SampleBatch) -> list[Message]:
    """What zenoh would deliver of a sender that publishes under wide keys."""
    payload, root = codec.encode_samples(batch), f"{keys.ROOT}/{WARD}"
    wide = (f"{root}/raw/{BRIDGE}/*", f"{root}/raw/*/{batch.device}", f"{root}/raw/**", f"{root}/**", "**",
            f"{root}/raw/{BRIDGE}/$*", f"{keys.ROOT}/*/raw/{BRIDGE}/{batch.device}")  # fmt: skip
    return [Message(key, payload) for key in wide]


def foreign(batch: SampleBatch, other: str) -> list[Message]:
    """Its samples under another's key, another bridge's, a stranger's."""
    theirs = codec.encode_samples(replace(batch, device=other))
    own = codec.encode_samples(batch)
    place = keys.build(WARD, "raw", bridge=BRIDGE, device=batch.device)
    return [
        Message(place, theirs),
        Message(keys.build(WARD, "raw", bridge=BRIDGE, device=other), own),
        Message(keys.build(WARD, "raw", bridge="intruder", device=batch.device), own),
        message(replace(batch, device="stranger")),
    ]  # fmt: skip


def forged(batch: SampleBatch, rng: np.random.Generator) -> list[Message]:
    """What its own bridge's key carries and no device can have said."""
    key, whole = message(batch)
    gyro = batch.gyro.copy()
    gyro[0, 0] = np.nan
    too_fast = np.full_like(batch.gyro, 1e6)
    leap = replace(batch, sequence=2**61, ticks=batch.ticks + np.uint64(2**61))
    back = replace(batch, ticks=batch.ticks[::-1])
    payloads = (
        b"", rng.bytes(200), rng.bytes(70_000), whole[: len(whole) // 2], b"\x08\x02" + whole[2:],
        *(codec.encode_samples(one) for one in (
            replace(batch, gyro=gyro), replace(batch, gyro=too_fast), replace(batch, gyro=batch.gyro[1:]),
            replace(batch, clock_rate=0.0), replace(batch, tick_period_s=-1.0), back, leap,
        )),
    )  # fmt: skip
    return [Message(key, payload) for payload in payloads]


def twice_shuffled(recorded: list[SampleBatch], rng: np.random.Generator) -> Iterator[SampleBatch]:
    """All of a recording in an order of chance, and then in another."""
    for _ in range(2):
        for i in rng.permutation(len(recorded)):
            yield recorded[i]


def introduced(device: str, boot: int) -> DeviceInfo:
    return replace(info(boot), device=device)


def of_boot(batch: SampleBatch, boot: int) -> SampleBatch:
    return replace(batch, boot=boot)


def state(served: Served, device: str) -> str:
    """A hash of all that a device's session is, but for what it has counted."""
    session = served.service._devices[device].session
    sequence, reason = session.sequence, session.life.reason
    sequence.is_new_boot(-1)  # which boots there were before is looked up when first asked for
    session.sequence = type(sequence)()  # its counters are to change
    session.learnt._events = session.sequence.events
    if session.life.state is State.LOST:
        session.life.reason = ()  # and so are the seconds since it was heard last
    try:
        what = pickle.dumps((session, sequence.boot, sequence.next, sequence.first, sorted(sequence._past.items())))
    finally:
        session.sequence, session.learnt._events, session.life.reason = sequence, sequence.events, reason
    return hashlib.sha256(what).hexdigest()


def lived(
    served: Served, streams: dict[str, Stream], *, boot: int, beside: Iterable[Message] = ()
) -> tuple[list[SampleBatch], list[CorrectedBatch]]:
    """Devices live through their streams, side by side, at their own pace: what they sent, and what was published.

    beside: what somebody else lays before the service meanwhile, about as much in each round.
    """
    cut = {name: named(of.batches(range(26, len(of), 26), boot=boot), name) for name, of in streams.items()}
    rows, said = list(zip_longest(*cut.values())), list[CorrectedBatch]()
    others = list(beside)
    for n, row in enumerate(rows):
        served.raw.messages += others[n * len(others) // len(rows) : (n + 1) * len(others) // len(rows)]
        for batch in row:
            if batch is not None:
                served.put(batch)
        said += served.round(0.25)
    return [batch for batches in cut.values() for batch in batches], said


def played(served: Served, messages: Iterable[Message]) -> int:
    """Lay messages before the service, no more in a second than a device may send; how many rates came of them."""
    said, lot = 0, list[Message]()
    for one in messages:
        lot.append(one)
        if len(lot) == EACH_ROUND:
            served.raw.messages += lot
            lot.clear()
            said += sum(map(len, served.round(ROUND_S)))
    served.raw.messages += lot
    said += sum(map(len, served.round(ROUND_S)))
    while len(served.service._quotas):
        said += sum(map(len, served.round(ROUND_S)))
    return said
