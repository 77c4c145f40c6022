"""A decoder behind a transport: read late, it takes what came, and no longer than it is given."""

import pytest

from bridge.drivers.driver import DeviceLost, Event, Notice
from bridge.drivers.stream import StreamDriver, StreamOptions
from bridge.transport.transport import Chunk
from bridge.wire.refusal import Tally


class Spelling:
    """Tells every byte, and each time that it is given none."""

    def __init__(self) -> None:
        self.faults = Tally()

    def opened(self) -> None:
        pass

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        return [Notice("byte", letter) for letter in data.decode()] or [Notice("nothing", "")]

    def to_send(self) -> bytes:
        return b""


class Kept:
    """What waits of a device: some chunks, then nothing, or its loss; or the same without end."""

    keeps = True
    place = "kept"

    def __init__(self, *chunks: bytes, endless: bool = False, lost: bool = False) -> None:
        self.faults = Tally()
        self.left = list(chunks)
        self._endless, self._lost = endless, lost

    def open(self) -> None:
        pass

    def read(self, timeout_s: float) -> Chunk:
        assert timeout_s == 0
        if self._endless:
            return Chunk(self.left[0], 1)
        if not self.left and self._lost:
            raise DeviceLost("gone")
        return Chunk(self.left.pop(0) if self.left else b"", 1)

    def write(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


def driver(kept: Kept) -> StreamDriver:
    made = StreamDriver(StreamOptions(port="tcp://127.0.0.1:1"), Spelling())
    made._transport = kept
    return made


def spelt(events: list[Event]) -> str:
    return "".join(event.text or "." for event in events if isinstance(event, Notice))


def test_all_that_waits_is_taken_and_then_it_is_told_that_time_goes_by() -> None:
    made = driver(Kept(b"ab", b"c"))
    assert spelt(made.read_kept(10.0)) == "abc."
    assert spelt(made.read_kept(10.0)) == "."


def test_a_flood_waits_for_the_next_turn() -> None:
    made = driver(Kept(b"ab", endless=True))
    assert spelt(made.read_kept(0.0)).startswith("ab")
    assert set(spelt(made.read_kept(0.001))) == {"a", "b"}, "time does not go by ahead of what waits"


def test_a_loss_is_told_behind_what_came_before_it() -> None:
    made = driver(Kept(b"ab", lost=True))
    assert spelt(made.read_kept(10.0)) == "ab."
    with pytest.raises(DeviceLost, match="gone"):
        made.read_kept(10.0)
