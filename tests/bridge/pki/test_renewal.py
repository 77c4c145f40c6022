"""A certificate ends while its holder publishes: renewed before, nothing is lost; not renewed, nothing more passes."""

import time
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path

import pytest

from bridge.bus.contract import BusError
from bridge.bus.zenoh_bus import ZenohBus
from bridge.pki.authority import issue
from bridge.pki.folder import utc_now
from bridge.pki.member import Member
from bridge.wire import keys
from tests.bridge.pki.guarded_ward import WARD, GuardedWard

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: renewal")]

B1, B2 = Member.parse("bridge:b1"), Member.parse("bridge:b2")


def test_a_renewal_costs_no_sample_and_an_end_is_one(tmp_path: Path) -> None:
    ward = GuardedWard(tmp_path / "pki")
    with ward.running(), ExitStack() as stack:
        began = time.monotonic()
        e1 = stack.enter_context(ward.bus("estimator:e1"))
        lasts = timedelta(seconds=2 + 20 * (time.monotonic() - began))  # two more such connections are made meanwhile
        heard = {
            who.name: e1.subscribe(keys.pattern(WARD, "raw", bridge=who.name), history=True, capacity=10_000)
            for who in (B1, B2)
        }
        ends = utc_now() + lasts
        for who in (B1, B2):
            files = ward.folder.identity(who)
            issuer, key = ward.folder.issuer(who), Path(files.key).read_bytes()
            pair = issue(issuer, who, utc_now() - timedelta(hours=1), ends, key=key)
            Path(files.certificate).write_bytes(pair.certificate)
        with ward.bus("bridge:b1") as b1, ward.bus("bridge:b2") as b2:
            publishers = [
                bus.publisher(keys.build(WARD, "raw", bridge=who.name, device="d"), cache=5000)
                for who, bus in ((B1, b1), (B2, b2))
            ]
            ward.folder.renew(B1, utc_now())
            sent, over = 0, False
            while not over:
                for publisher in publishers:
                    publisher.put(b"%d" % sent)
                sent += 1
                time.sleep(0.01)
                # Both connections end; who has been renewed is back within milliseconds.
                over = b1.connected and not b2.connected and utc_now() > ends + timedelta(seconds=1)
                assert utc_now() < ends + timedelta(seconds=60), (
                    "who was not renewed is still there, or who was is not back"
                )
            got: list[int] = []
            while len(got) < sent and (message := heard["b1"].receive(30.0)) is not None:
                got.append(int(message.payload))
            assert got == list(range(sent))
            assert heard["b1"].missed == 0
            assert 0 < len(heard["b2"].drain(10_000, 0.5)) < sent
        with pytest.raises(BusError, match="expired on"):
            ZenohBus(ward.routers("bridge:b2"))
