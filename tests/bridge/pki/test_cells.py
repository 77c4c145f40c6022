"""Every role × kind of key: allowed cells deliver, all others exactly nothing."""

import json
from collections.abc import Iterator

import pytest
import zenoh

from bridge.bus import zenoh_settings
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys
from tests.bridge.bus.worlds import eventually, meet
from tests.bridge.pki import cells
from tests.bridge.pki.guarded_ward import MEMBERS, WARD, GuardedWard

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: cells")]

COUNT = 100
EVERY = keys.everything(WARD)
WIDE = ("**", "truerate/**", "truerate/@v1/**", EVERY, "truerate/@v1/*/raw/*/*", f"{keys.ROOT}/{WARD}/*/*")


@pytest.fixture(scope="module")
def ward(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GuardedWard]:
    made = GuardedWard(tmp_path_factory.mktemp("pki"), (*MEMBERS, cells.WITNESS))
    with made.running():
        yield made


def test_who_may_say_what(ward: GuardedWard) -> None:
    assert cells.published(ward, COUNT) == cells.expected(cells.MAY_SAY, COUNT)


def test_who_hears_what(ward: GuardedWard) -> None:
    assert cells.heard(ward, COUNT) == cells.expected(cells.MAY_HEAR, COUNT)


def test_who_gets_the_history_of_what(ward: GuardedWard) -> None:
    assert cells.asked(ward, COUNT) == cells.expected(cells.MAY_LOOK_BACK, COUNT)


def test_whose_tokens_are_seen_by_whom(ward: GuardedWard) -> None:
    declared, seen = cells.lived(ward)
    assert declared == cells.expected(cells.MAY_LIVE, 1)
    assert seen == cells.expected(cells.MAY_SEE_ALIVE, 1)


def test_only_commanders_command_and_only_estimators_obey(ward: GuardedWard) -> None:
    assert cells.commanded(ward) == {
        ("commander:c1", "asks"): 1,
        **{(f"estimator:{name}", "answers"): 1 for name in ("e1", "e2")},
    }


def opened(ward: GuardedWard, who: str) -> zenoh.Session:
    """A session of somebody who does not use our program, with our certificate."""
    settings = zenoh_settings.client([ward.endpoint], ward.routers(who).identity)
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


def _drained(channel: zenoh.handlers.Handler[zenoh.Sample]) -> Iterator[zenoh.Sample]:
    while (sample := channel.try_recv()) is not None:
        yield sample


@pytest.mark.parametrize("who", [who for who in MEMBERS if who != "recorder:r1"])
def test_wide_keys_reach_nobody_and_wide_subscriptions_get_nothing(who: str, ward: GuardedWard) -> None:
    raw, status = cells.KEYS["raw of b2"], cells.KEYS["status"]
    with opened(ward, who) as session, ward.bus("estimator:e1") as e1, ward.bus("bridge:b2") as b2:
        wide = [session.declare_subscriber(key, zenoh.handlers.FifoChannel(1000)) for key in WIDE]
        heard = e1.subscribe(keys.pattern(WARD, "raw"))
        looked = b2.subscribe(keys.pattern(WARD, "status"))
        said, told = e1.publisher(status), b2.publisher(raw)
        meet(said, looked)
        meet(told, heard)
        for key in WIDE:
            session.put(key, b"forged")
        said.put(b"status")
        told.put(b"raw")
        messages = [heard.receive(30.0), looked.receive(30.0)]
        assert [m.payload if m else m for m in messages] == [b"raw", b"status"]
        assert heard.receive(0.2) is None
        assert looked.receive(0.0) is None
        payloads = [sample.payload.to_bytes() for one in wide for sample in _drained(one.handler)]
        assert set(payloads) <= {b"forged"}  # its own, which never left its session


def test_nobody_invents_the_history_of_somebody_else(ward: GuardedWard) -> None:
    key = cells.KEYS["raw of b1"]
    for who in ("bridge:b2", "estimator:e1", "viewer:v1", "commander:c1", "recorder:r1"):
        with opened(ward, who) as forger, ward.bus("estimator:e1") as e1, ward.bus("bridge:b1") as b1:
            answering = forger.declare_queryable(f"{key}/@adv/**", zenoh.handlers.FifoChannel(10), complete=True)
            b1.publisher(key, cache=1).put(b"true")
            came: list[bytes] = []

            def answered(came: list[bytes] = came, e1: ZenohBus = e1) -> bool:
                came += cells.past(e1, key)
                return bool(came)

            eventually(answered)
            assert came == [b"true"]
            assert answering.handler.try_recv() is None


def test_what_is_too_large_stays_outside(ward: GuardedWard) -> None:
    with ward.bus("bridge:b1") as b1, ward.bus("estimator:e1") as e1:
        heard = e1.subscribe(keys.pattern(WARD, "raw"))
        publisher = b1.publisher(cells.KEYS["raw of b1"])
        meet(publisher, heard)
        for size in (65_536, 65_537, 1):
            publisher.put(b"x" * size)
        messages = [heard.receive(30.0), heard.receive(30.0)]
        assert [len(m.payload) if m else m for m in messages] == [65_536, 1]
