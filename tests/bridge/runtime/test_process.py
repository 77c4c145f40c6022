"""A process waits for its router and stops when asked."""

import signal
import threading
import time
from collections.abc import Sequence

import pytest

from bridge.bus import startup
from bridge.bus.contract import Bus, BusError, Declared
from bridge.bus.startup import wait_for_router
from bridge.runtime.signals import stopped_by_signal
from bridge.wire import keys
from tests.memory_bus import MemoryBroker, MemoryBus


class Coming:
    """A router that is there at the third try."""

    def __init__(self) -> None:
        self.tries = 0

    def __call__(self, endpoints: Sequence[str]) -> Bus:
        self.tries += 1
        if self.tries < 3:
            raise BusError(f"no router at {endpoints[0]}")
        return MemoryBus(MemoryBroker())


def test_a_router_is_waited_for_and_its_absence_said_once(caplog: pytest.LogCaptureFixture) -> None:
    coming, began = Coming(), time.monotonic()
    bus = wait_for_router(["here"], threading.Event(), patient=True, open_bus=coming)
    assert bus is not None
    assert bus.connected
    assert coming.tries == 3
    assert time.monotonic() - began < 60.0
    assert [record.message for record in caplog.records] == ["no router at here; trying again until a router answers"]


def test_who_is_not_patient_hears_at_once() -> None:
    coming = Coming()
    with pytest.raises(BusError, match="no router at here"):
        wait_for_router(["here"], threading.Event(), patient=False, open_bus=coming)
    assert coming.tries == 1


def test_waiting_ends_when_it_is_stopped() -> None:
    stop = threading.Event()
    threading.Timer(0.1, stop.set).start()

    def never(endpoints: Sequence[str]) -> Bus:
        raise BusError("never")

    assert wait_for_router(["here"], stop, patient=True, open_bus=never) is None


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_first_signal_asks_and_a_second_would_end(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with stopped_by_signal() as stop:
        assert not stop.is_set()
        signal.raise_signal(number)
        assert stop.is_set()
        assert signal.getsignal(number) is signal.SIG_DFL
    assert signal.getsignal(number) is before


def test_a_second_bridge_of_one_name_is_refused_and_another_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(startup, "_LOOK_S", 0.0)
    monkeypatch.setattr(startup, "_GONE_S", 0.2)
    broker = MemoryBroker()
    first, second = MemoryBus(broker), MemoryBus(broker)
    for bus, name in ((first, "b1"), (second, "b2")):
        bus.declare_alive(keys.build("w", "alive/bridge", bridge=name))

    def claim(own: str) -> tuple[list[str], Declared]:
        others, told = list[str](), threading.Event()

        def another(name: str) -> None:
            others.append(name)
            if name == "b2":  # the last of both
                told.set()

        return others, startup.claim_id(MemoryBus(broker), "w", "bridge", own, another, lambda: told.wait(60))

    with pytest.raises(BusError, match="another bridge b1 already serves ward w: stop that bridge, or"):
        claim("b1")
    others, claimed = claim("b3")
    claimed.close()
    assert others == ["b1", "b2"]
    monkeypatch.setattr(startup, "_GONE_S", 60.0)
    threading.Timer(0.1, first.close).start()  # it was killed, and is only now found to be gone
    claim("b1")[1].close()
