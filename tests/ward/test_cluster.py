"""Three estimators share a ward: one is killed, one hangs and wakes up; each sample is given once, and by whose device it is."""

import contextlib
from collections.abc import Iterator
from itertools import pairwise

import pytest

from bridge.bus.contract import BusError
from bridge.bus.embedded_router import Router
from estimator.demo.ward import free_port
from tests.ward.shared import Shared, shared

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("cluster"), pytest.mark.timeout(180)]
DEVICES = 6


class Place:
    """Where the router is; it can be taken away."""

    def __init__(self) -> None:
        while not hasattr(self, "_router"):  # another test process may take the free port first
            self.endpoint = f"tcp/127.0.0.1:{free_port()}"
            with contextlib.suppress(BusError):
                self.start()

    def start(self) -> None:
        self._router = Router([self.endpoint])

    def stop(self) -> None:
        self._router.close()


@pytest.fixture
def place() -> Iterator[Place]:
    made = Place()
    yield made
    made.stop()


@pytest.fixture
def ward(place: Place) -> Iterator[Shared]:
    with shared(place.endpoint, DEVICES) as made:
        yield made


def assert_each_sample_once(ward: Shared) -> None:
    """From the first that was taken on, in order, and of no older epoch after a newer one."""
    for device in ward.names:
        batches = [batch for batch in ward.taken if batch.device == device]
        assert [b.sequence + len(b) for b in batches[:-1]] == [b.sequence for b in batches[1:]], device
        assert all(before.epoch <= after.epoch for before, after in pairwise(batches)), device
        assert batches[-1].sequence + len(batches[-1]) == ward.bridge.sent


def test_who_is_killed_or_hangs_is_missed_by_nobody(ward: Shared) -> None:
    for name in ("e1", "e2", "e3"):
        ward.start(name)
    ward.until(lambda: ward.settled() and min(ward.split()) > 0 and ward.reached > 100)
    lost = ward.running["e2"].devices
    ward.kill("e2")
    ward.until(ward.settled)
    ward.until(lambda: ward.reached >= ward.bridge.sent - 20)
    assert lost <= ward.running["e1"].devices | ward.running["e3"].devices

    ward.running["e1"].hang()
    ward.until(lambda: len(ward.running["e3"].devices) == DEVICES)
    ward.until(lambda: ward.reached >= ward.bridge.sent - 20)
    newest = {batch.device: batch.epoch for batch in ward.taken}
    ward.running["e1"].wake()
    ward.until(lambda: ward.settled() and min(ward.split()) > 0)
    ward.finish()
    assert_each_sample_once(ward)
    assert all(batch.epoch >= newest[batch.device] for batch in ward.taken[-DEVICES:])
    assert ward.stream.missing == {}
    assert all(one.service.counts.as_dict().get("conservation law broken") is None for one in ward.running.values())


def test_a_router_that_was_away_leaves_every_device_with_one_estimator(ward: Shared, place: Place) -> None:
    for name in ("e1", "e2"):
        ward.start(name)
    ward.until(lambda: ward.settled() and min(ward.split()) > 0 and ward.reached > 100)
    ward.listen(1.0)
    epochs = {d: e for one in ward.running.values() for d, e in one.service._cluster.membership.held.copy().items()}
    place.stop()
    ward.listen(1.5)
    # A router that ends takes the line of one before that of the other, who takes its devices, and may still be heard.
    now = [one.service._cluster.membership.held for one in ward.running.values()]
    for device, epoch in epochs.items():
        assert max(held.get(device, 0) for held in now) >= epoch, "nobody gives up what nobody took"
    place.start()
    away = ward.bridge.sent
    # Who is back first may take the others' for a while; in the end each has one owner.
    ward.until(lambda: ward.reached >= away + 300 and ward.settled())
    ward.finish()
    assert_each_sample_once(ward)
