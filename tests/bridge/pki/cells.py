"""Every role tried on every kind of key: what a router with rules lets through, counted. For the tests, and their bench."""

import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack

from bridge.bus.contract import BusError, Message, Publisher
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys
from tests.bridge.pki.guarded_ward import MEMBERS, WARD, GuardedWard

BY_NAME = "@windowed"  # what `**` does not match
ESTIMATES = ("corrected", "status", "calibration", "revision", "note", BY_NAME)
KEYS = {
    "raw of b1": keys.build(WARD, "raw", bridge="b1", device="d1"),
    "raw of b2": keys.build(WARD, "raw", bridge="b2", device="d2"),
    "info of b1": keys.build(WARD, "info", bridge="b1", device="d1"),
    **{what: keys.build(WARD, what, device="d1") for what in (*ESTIMATES, "checkpoint")},
    "owned by e1": keys.build(WARD, "owned", estimator="e1"),
    "owned by e2": keys.build(WARD, "owned", estimator="e2"),
}
TOKENS = {
    "bridge b1": keys.build(WARD, "alive/bridge", bridge="b1"),
    "estimator e1": keys.build(WARD, "alive/estimator", estimator="e1"),
    "device d1": keys.build(WARD, "alive/device", device="d1", boot=keys.boot_id(1)),
}
NOBODY: dict[str, set[str]] = {who: set() for who in MEMBERS}
# Written down here once more, by hand: what the rules are must not be what they are tested against.
MAY_SAY = NOBODY | {
    "bridge:b1": {"raw of b1", "info of b1"},
    "bridge:b2": {"raw of b2"},
    "estimator:e1": {*ESTIMATES, "checkpoint", "owned by e1"},
    "estimator:e2": {*ESTIMATES, "checkpoint", "owned by e2"},
}
FOR_ESTIMATORS = {"raw of b1", "raw of b2", "info of b1", "checkpoint", "owned by e1", "owned by e2"}
MAY_HEAR = {
    "bridge:b1": {"status"},
    "bridge:b2": {"status"},
    "estimator:e1": FOR_ESTIMATORS,
    "estimator:e2": FOR_ESTIMATORS,
    "viewer:v1": {"info of b1", "owned by e1", "owned by e2", *ESTIMATES},
    "commander:c1": set(KEYS) - {"checkpoint"},
    "recorder:r1": set(KEYS) - {BY_NAME},
}
MAY_LIVE = NOBODY | {
    "bridge:b1": {"bridge b1", "device d1"},
    "bridge:b2": {"device d1"},
    "estimator:e1": {"estimator e1"},
}
MAY_SEE_ALIVE = {
    "bridge:b1": {"bridge b1"},
    "bridge:b2": {"bridge b1"},
    **{who: set(TOKENS) for who in MEMBERS[2:]},
}
# These kinds have no cache.
KEPT = {kind: key for kind, key in KEYS.items() if kind != BY_NAME and not kind.startswith("owned")}
MAY_LOOK_BACK = {who: kinds & set(KEPT) for who, kinds in MAY_HEAR.items()}
SOURCES = {kind: next(who for who, kinds in MAY_SAY.items() if kind in kinds) for kind in KEYS}
WITNESS = "recorder:r2"
SETTLED_S = 0.5
# What people look at a router drops for who is slow, and who takes nothing it cuts off: so many at once, then they have to come.
PORTION, COMES_S = 1000, 20.0

Counts = Counter[tuple[str, str]]


def expected(may: dict[str, set[str]], count: int) -> Counts:
    """All cells: `count` where it is allowed, 0 (no entry) elsewhere."""
    return Counter({(who, kind): count for who, kinds in may.items() for kind in kinds})


def published(ward: GuardedWard, count: int) -> Counts:
    """Everybody says everything `count` times; a witness counts whose words come through."""
    said, total = Counts(), sum(len(kinds) for kinds in MAY_SAY.values()) * count
    with ExitStack() as stack:
        witness = stack.enter_context(ward.bus(WITNESS))
        looks = stack.enter_context(ward.bus("viewer:v1")).subscribe(KEYS[BY_NAME], capacity=total + 1000)
        wide = witness.subscribe(keys.everything(WARD), capacity=2 * total + 1000)
        time.sleep(SETTLED_S)
        for who in MEMBERS:
            bus = stack.enter_context(ward.bus(who))
            for kind, key in KEYS.items():
                publisher, payload = bus.publisher(key), f"{who} {kind}".encode()
                may = kind in MAY_SAY[who]

                def all_came(put: int, cell: tuple[str, str] = (who, kind), may: bool = may) -> bool:
                    _count(said, wide.drain(1 << 20, 0.0) + looks.drain(1 << 20, 0.0))
                    return not may or said[cell] >= put

                _put(publisher, payload, count, all_came)
        _count_all(said, lambda: wide.drain(1 << 20, SETTLED_S) + looks.drain(1 << 20, 0.0), total)
    return said


def heard(ward: GuardedWard, count: int) -> Counts:
    """Who may says everything `count` times; everybody listens to everything, kind by kind, exactly as wide as a key."""
    said, total = Counts(), sum(len(kinds) for kinds in MAY_HEAR.values()) * count
    with ExitStack() as stack:
        subscriptions = [
            (who, kind, bus.subscribe(key, capacity=2 * count + 10))
            for who in MEMBERS
            for bus in [stack.enter_context(ward.bus(who))]
            for kind, key in KEYS.items()
        ]
        sources = {who: stack.enter_context(ward.bus(who)) for who in set(SOURCES.values())}
        time.sleep(SETTLED_S)

        known = set[tuple[str, str]]()

        def take() -> None:
            for who, kind, subscription in subscriptions:
                messages = subscription.drain(1 << 20, 0.0)
                said[who, kind] += sum(message.payload == b"x" for message in messages)
                if messages:
                    known.add((who, kind))

        for kind, key in KEYS.items():
            publisher, allowed = (
                sources[SOURCES[kind]].publisher(key),
                {who for who in MEMBERS if kind in MAY_HEAR[who]},
            )

            def all_hear(kind: str = kind, publisher: Publisher = publisher, allowed: set[str] = allowed) -> bool:
                publisher.put(b"?")
                take()
                return known >= {(who, kind) for who in allowed}

            def all_came(put: int, kind: str = kind, allowed: set[str] = allowed) -> bool:
                take()
                return all(said[who, kind] >= put for who in allowed)

            _within_patience(all_hear)
            _put(publisher, b"x", count, all_came)
        deadline, quiet = time.monotonic() + 60, 0.0
        while time.monotonic() < deadline and quiet < SETTLED_S:
            before = sum(said.values())
            take()
            time.sleep(0.05)
            done = sum(said.values()) >= total or before > 0
            quiet = quiet + 0.05 if done and sum(said.values()) == before else 0.0
    return +said


def past(bus: ZenohBus, key: str) -> list[bytes]:
    """What everybody who answers for the history of a key has of it."""
    return [reply.ok.payload.to_bytes() for reply in bus.past(key) if reply.ok is not None]


def asked(ward: GuardedWard, count: int) -> Counts:
    """Who may keeps `count` messages of everything; everybody asks for the history of every key."""
    said = Counts()
    with ExitStack() as stack:
        sources = {who: stack.enter_context(ward.bus(who)) for who in set(SOURCES.values())}
        for kind, key in KEPT.items():
            publisher = sources[SOURCES[kind]].publisher(key, cache=count)
            for _ in range(count):
                publisher.put(b"x")
        time.sleep(SETTLED_S)
        for who in MEMBERS:
            bus = stack.enter_context(ward.bus(who))
            for kind, key in KEPT.items():

                def whole(cell: tuple[str, str] = (who, kind), bus: ZenohBus = bus, key: str = key) -> bool:
                    said[cell] = len(past(bus, key))
                    return said[cell] >= count or cell[1] not in MAY_LOOK_BACK[cell[0]]

                _within_patience(whole)
    return +said


def lived(ward: GuardedWard) -> tuple[Counts, Counts]:
    """Whose tokens a witness sees of all that everybody declares; and which of the true ones everybody sees."""
    declared, seen = Counts(), Counts()
    for who in MEMBERS:
        with ward.bus(WITNESS) as witness, ward.bus(who) as bus:
            found: dict[str, bool] = {}
            witness.watch_alive(f"{keys.ROOT}/{WARD}/alive/**", found.__setitem__)
            tokens = [bus.declare_alive(key) for key in TOKENS.values()]
            _within_patience(lambda found=found, who=who: all(found.get(TOKENS[kind]) for kind in MAY_LIVE[who]))  # type: ignore[misc]
            time.sleep(SETTLED_S)
            declared.update((who, kind) for kind, key in TOKENS.items() if found.get(key))
            del tokens
    with ward.bus("bridge:b1") as b1, ward.bus("estimator:e1") as e1, ExitStack() as stack:
        for bus, kind in ((b1, "bridge b1"), (b1, "device d1"), (e1, "estimator e1")):
            bus.declare_alive(TOKENS[kind])
        watched = []
        for who in MEMBERS:
            listener = stack.enter_context(ward.bus(who))
            found = {}
            for key in TOKENS.values():
                listener.watch_alive(key, found.__setitem__)
            watched.append((who, found))
        _within_patience(lambda: all(f.get(TOKENS[kind]) for who, f in watched for kind in MAY_SEE_ALIVE[who]))
        time.sleep(SETTLED_S)
        for who, found in watched:
            seen.update((who, kind) for kind, key in TOKENS.items() if found.get(key))
    return declared, seen


def commanded(ward: GuardedWard) -> Counts:
    """Who gets an answer from an estimator; and whose answers to a command its asker takes."""
    said, key = Counts(), keys.build(WARD, "rpc", device="d1", verb="note")
    with ward.bus("estimator:e1") as e1, ExitStack() as stack:
        e1.answer(keys.pattern(WARD, "rpc"), lambda _, payload, reply: reply(payload))
        for who in MEMBERS:
            if who != "estimator:e1":
                asking = stack.enter_context(ward.bus(who))
                said[who, "asks"] = _answered(asking, key, tries=20 if who == "commander:c1" else 1)
    for who in MEMBERS:
        if who != "commander:c1":
            with ward.bus(who) as bus, ward.bus("commander:c1") as commander:
                bus.answer(keys.pattern(WARD, "rpc"), lambda _, payload, reply: reply(payload))
                time.sleep(0.1)
                said[who, "answers"] = _answered(commander, key, tries=20 if who.startswith("estimator:") else 1)
    return +said


def _answered(bus: ZenohBus, key: str, tries: int) -> int:
    """Whether it is; who may has some tries, as nobody says when a router knows of who answers."""
    for _ in range(tries):
        try:
            return int(bus.ask(key, b"please", 2.0) == b"please")
        except BusError:
            time.sleep(0.1)
    return 0


def _within_patience(right: Callable[[], bool]) -> None:
    """Wait for what may come."""
    deadline = time.monotonic() + COMES_S
    while not right() and time.monotonic() < deadline:
        time.sleep(0.01)


def _put(publisher: Publisher, payload: bytes, count: int, all_came: Callable[[int], bool]) -> None:
    """Say it `count` times, in portions, each of which has to come before the next; once one does not, nobody is waited for."""
    patient = True
    for put in range(1, count + 1):
        publisher.put(payload)
        if patient and (put % PORTION == 0 or put == count):
            deadline = time.monotonic() + COMES_S
            while not all_came(put) and (patient := time.monotonic() < deadline):
                time.sleep(0.001)


def _count(said: Counts, messages: list[Message]) -> None:
    for message in messages:
        who, _, kind = message.payload.decode().partition(" ")
        if KEYS[kind] == message.key:
            said[who, kind] += 1


def _count_all(said: Counts, drain: Callable[[], list[Message]], total: int) -> None:
    """Until all that is allowed has come, and then nothing more does."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        messages = drain()
        _count(said, messages)
        if not messages and sum(said.values()) >= total:
            return
