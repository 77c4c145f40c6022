"""Wards joined by a hospital's router: each keeps its own rules, and neither can speak for the other."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.bus import router_file
from bridge.bus.contract import Subscription
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member
from bridge.wire import keys
from estimator.demo.ward import free_port
from tests.bridge.pki.guarded_ward import HOSTS, STARTS_S, running_router

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: joined_wards")]

#: at which router -> who has the rights of its role in which ward
PLACES = {
    "router:r3": [("w3", "bridge:b3"), ("w3", "estimator:e3"), ("w3", "viewer:v3"), ("w3", "router:hospital")],
    # This one is not to be trusted: its rules let its bridge, and the hospital, have to do with the other ward.
    "router:r4": [(ward, who) for ward in ("w4", "w3") for who in ("bridge:b4", "estimator:e4", "router:hospital")],
    "router:hospital": [("w3", "router:r3"), ("w4", "router:r4"), ("w3", "recorder:all"), ("w4", "recorder:all")],
}


class Hospital:
    """Three routers, each in a process of its own; the hospital's joins the wards'."""

    def __init__(self, path: Path) -> None:
        self._folder = Folder(path)
        self._folder.make("a hospital", utc_now())
        for who in dict.fromkeys([*PLACES, *(who for places in PLACES.values() for _, who in places)]):
            self._folder.issue(Member.parse(who), utc_now(), hosts=HOSTS if who.startswith("router") else ())
        self.endpoints = {router: f"tls/127.0.0.1:{free_port()}" for router in PLACES}
        for router, endpoint in self.endpoints.items():
            join = [e for e in self.endpoints.values() if e != endpoint] if router == "router:hospital" else []
            places = [(ward, Member.parse(who)) for ward, who in PLACES[router]]
            self._folder.admit(Member.parse(router), [who for _, who in places])
            settings = router_file.guarded([endpoint], self._folder.gate(Member.parse(router)), places, join)
            self.file(router).write_text(router_file.rendered(settings, router), "utf-8")

    def file(self, router: str) -> Path:
        return self._folder.path / f"{router.replace(':', '.')}.json5"

    def bus(self, who: str, router: str) -> ZenohBus:
        return ZenohBus(
            Routers((self.endpoints[router],), self._folder.identity(Member.parse(who))), open_timeout_s=STARTS_S
        )


@pytest.fixture
def hospital(tmp_path: Path) -> Iterator[Hospital]:
    made = Hospital(tmp_path / "pki")
    # The hospital's comes first, and finds nobody yet.
    with (
        running_router(made.file("router:hospital"), made.endpoints["router:hospital"]),
        running_router(made.file("router:r3"), made.endpoints["router:r3"]),
        running_router(made.file("router:r4"), made.endpoints["router:r4"]),
    ):
        yield made


def some(subscription: Subscription, count: int) -> list[bytes]:
    """The payloads of so many messages, or of those that come before a long silence."""
    found: list[bytes] = []
    while len(found) < count and (message := subscription.receive(30.0)) is not None:
        found.append(message.payload)
    return found


def test_a_hospital_hears_its_wards_and_no_ward_another(hospital: Hospital) -> None:
    with (
        hospital.bus("bridge:b3", "router:r3") as b3,
        hospital.bus("estimator:e3", "router:r3") as e3,
        hospital.bus("bridge:b4", "router:r4") as b4,
        hospital.bus("estimator:e4", "router:r4") as e4,
        hospital.bus("recorder:all", "router:hospital") as all_of_it,
    ):
        w3, w4 = (keys.build(f"w{n}", "raw", bridge=f"b{n}", device="d") for n in (3, 4))
        witness = [all_of_it.subscribe(keys.everything(ward), history=True) for ward in ("w3", "w4")]
        heard = [e.subscribe(keys.pattern(w, "raw"), history=True) for e, w in ((e3, "w3"), (e4, "w4"))]
        across = e4.subscribe(keys.pattern("w3", "raw"), history=True)
        publishers = [bus.publisher(key, cache=100) for bus, key in ((b3, w3), (b4, w4))]
        for n in range(10):  # as they are being joined
            for publisher in publishers:
                publisher.put(b"%d" % n)
            time.sleep(0.1)
        for one in (*witness, *heard):
            assert some(one, 10) == [b"%d" % n for n in range(10)]
        # Its own router would let it speak for the other ward, and pass that on; the hospital's does not take it.
        forged = keys.build("w3", "raw", bridge="b4", device="d")
        b4.publisher(forged).put(b"forged")
        publishers[1].put(b"last")
        assert some(witness[1], 1) == [b"last"]
        assert [one.receive(0.3) for one in (witness[0], heard[0])] == [None] * 2
        assert some(across, 1) == [b"forged"]  # in its own ward; and nothing true of the other one
        assert across.receive(0.3) is None
