"""The contract of a bus, held by both: a world of either kind, and two buses in it."""

from collections.abc import Iterator

import pytest

from bridge.bus.contract import Bus
from tests.bridge.bus.worlds import MemoryWorld, World, ZenohWorld


@pytest.fixture(params=[MemoryWorld, ZenohWorld])
def world(request: pytest.FixtureRequest) -> Iterator[World]:
    made: World = request.param()
    yield made
    made.stop()


@pytest.fixture
def a(world: World) -> Iterator[Bus]:
    with world.bus() as bus:
        yield bus


@pytest.fixture
def b(world: World) -> Iterator[Bus]:
    with world.bus() as bus:
        yield bus
