"""What only a real network of processes can show: killed routers, frozen readers, failing programs."""

import contextlib
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator

import pytest

from bridge.bus.contract import BusError
from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from estimator.demo.ward import free_port
from tests.bridge.bus.worlds import eventually

pytestmark = pytest.mark.ward

ROUTER = """
    import sys, threading
    from bridge.bus.embedded_router import Router
    with Router([sys.argv[1]], shed=sys.argv[2:]):
        print("up", flush=True)
        threading.Event().wait()
"""
READER = """
    import sys
    from bridge.bus.zenoh_bus import ZenohBus
    with ZenohBus([sys.argv[1]]) as bus:
        subscription = bus.subscribe("t/**", history=True)
        print("up", flush=True)
        while True:
            subscription.drain(1000, 1.0)
"""
FAILING = """
    import sys
    from bridge.bus.zenoh_bus import ZenohBus
    bus = ZenohBus([sys.argv[1]])
    kept = [
        bus.publisher("t/x", cache=5), bus.subscribe("t/x", history=True), bus.subscribe("t/x"),
        bus.answer("q", lambda key, payload: payload), bus.watch_alive("**", lambda key, alive: None),
    ]
    print("up", flush=True)
    raise RuntimeError("on purpose")
"""


class Processes:
    """Python programs of this test; none outlives it."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[str]] = []

    def start(self, program: str, *arguments: str) -> subprocess.Popen[str]:
        """Run a program until it says that it is up."""
        process = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(program), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._running.append(process)
        assert process.stdout is not None
        if process.stdout.readline() != "up\n":
            process.kill()
            raise RuntimeError(process.communicate()[1])
        return process

    def end(self) -> None:
        for process in self._running:
            process.kill()
            process.communicate()


@pytest.fixture
def processes() -> Iterator[Processes]:
    made = Processes()
    yield made
    made.end()


def free_endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def test_a_killed_router_costs_nothing(processes: Processes) -> None:
    endpoint = free_endpoint()
    router = processes.start(ROUTER, endpoint)
    got: list[int] = []
    with ZenohBus([endpoint]) as a, ZenohBus([endpoint]) as b:
        publisher, subscription = a.publisher("t/raw", cache=2000), b.subscribe("t/raw", history=True)
        time.sleep(0.1)
        began = time.monotonic()
        for n in range(800):  # 4 s at 200 Hz, the router away from 1 s to 2 s
            publisher.put(b"%d" % n)
            if n == 200:
                router.send_signal(signal.SIGKILL)
                router.wait()
            if n == 400:
                processes.start(ROUTER, endpoint)
            got += [int(m.payload) for m in subscription.drain(1000, 0)]
            time.sleep(max(0.0, began + n * 0.005 - time.monotonic()))
        while len(got) < 800 and (message := subscription.receive(60.0)):
            got.append(int(message.payload))
        assert got == list(range(800))
        assert subscription.missed == 0
        assert a.connected
        assert b.connected


def test_a_frozen_reader_does_not_silence_the_others(processes: Processes) -> None:
    # A machine that is busy stands still now and then; a frozen reader that silences others does so each time.
    assert any(longest_silence_beside_a_frozen_reader(processes) < 1.0 for _ in range(4))


def longest_silence_beside_a_frozen_reader(processes: Processes) -> float:
    """How long a put took, or nothing came, at most, s; nothing is lost meanwhile."""
    endpoint = free_endpoint()
    processes.start(ROUTER, endpoint, "t/**")
    frozen = processes.start(READER, endpoint)
    with ZenohBus([endpoint]) as a, ZenohBus([endpoint]) as b:
        publisher, subscription = a.publisher("t/raw", cache=5000), b.subscribe("t/raw", history=True)
        payload = bytes(4096)
        publisher.put(payload)
        eventually(lambda: bool(subscription.drain(1000, 0.1)))
        got, longest, last = 1, 0.0, time.monotonic()
        began = last
        for n in range(4000):  # 8 MB/s, more than the buffers between here and the frozen reader hold
            if n == 500:
                frozen.send_signal(signal.SIGSTOP)
            before = time.monotonic()
            publisher.put(payload)
            longest = max(longest, time.monotonic() - before)
            if new := len(subscription.drain(1000, 0)):
                longest, last = max(longest, time.monotonic() - last), time.monotonic()
                got += new
            time.sleep(max(0.0, began + n * 0.0005 - time.monotonic()))
        while got < 4001 and (new := len(subscription.drain(1000, 10.0))):
            got += new
        assert (got, subscription.missed) == (4001, 0)
    return longest


def test_a_second_endpoint_is_used_when_the_first_is_dead_or_dies(processes: Processes) -> None:
    first, second, dead = free_endpoint(), free_endpoint(), free_endpoint()
    router = processes.start(ROUTER, first)
    with ZenohBus([dead, first, second]) as bus:
        assert bus.connected
        processes.start(ROUTER, second)
        router.send_signal(signal.SIGKILL)
        router.wait()
        with ZenohBus([second]) as other:
            publisher, subscription = bus.publisher("t/x"), other.subscribe("t/x")
            arrived = False
            while not arrived:
                publisher.put(b"1")
                arrived = subscription.receive(0.05) is not None


def test_a_failing_program_ends(processes: Processes) -> None:
    endpoint = free_endpoint()
    with Router([endpoint]):
        process = processes.start(FAILING, endpoint)
        _, said = process.communicate(timeout=60.0)
        assert process.returncode == 1
        assert "on purpose" in said


def test_no_router_and_a_busy_port_are_said_plainly() -> None:
    endpoint = free_endpoint()
    with pytest.raises(BusError, match=f"no router answered at {endpoint}.*truerate router"):
        ZenohBus([endpoint], open_timeout_s=0.3)
    with (
        Router([endpoint]),
        pytest.raises(BusError, match=f"cannot listen on {endpoint}.*another program listens there already"),
    ):
        Router([endpoint])
    for bad in ([], ["no endpoint"]):
        with pytest.raises(BusError):
            ZenohBus(bad, open_timeout_s=0.0)
        with pytest.raises(BusError):
            Router(bad)


def test_idle_connections_lock_nobody_out() -> None:
    endpoint = free_endpoint()
    address = ("127.0.0.1", int(endpoint.rsplit(":", 1)[1]))
    with Router([endpoint]), contextlib.ExitStack() as stack:
        for _ in range(300):
            stack.enter_context(socket.create_connection(address))
        with ZenohBus([endpoint], open_timeout_s=30.0) as bus:
            assert bus.connected
