"""A bus within the program, and who listens on it."""

from collections.abc import Iterator

import pytest

from tests.bridge.ingest.published.hearing import Listener
from tests.memory_bus import MemoryBroker


@pytest.fixture
def broker() -> MemoryBroker:
    return MemoryBroker()


@pytest.fixture
def listener(broker: MemoryBroker) -> Iterator[Listener]:
    listening = Listener(broker)
    yield listening
    listening.close()
