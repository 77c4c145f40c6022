"""Connections that never show a certificate: who is in does not notice, and who comes is let in once they are done with.

zenoh waits 10 s for each, and then takes 0.1 s for each that failed, one after the other, in which nobody is let in
(https://github.com/eclipse-zenoh/zenoh/issues/2685): SECURITY.md says so.
"""

import contextlib
import socket
import threading
import time
from pathlib import Path

import pytest

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys
from tests.bridge.bus.worlds import meet
from tests.bridge.pki.guarded_ward import WARD, GuardedWard

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("guarded ward: locked out")]

IDLE, HANDSHAKE_S = 20, 10.0


def test_who_is_in_does_not_notice_idle_connections_and_who_comes_is_let_in(tmp_path: Path) -> None:
    ward, key = GuardedWard(tmp_path / "pki"), keys.build(WARD, "raw", bridge="b1", device="d")
    with ward.running(), ward.bus("bridge:b1") as b1, ward.bus("estimator:e1") as e1, contextlib.ExitStack() as stack:
        heard, publisher, stop = e1.subscribe(key, capacity=10_000), b1.publisher(key), threading.Event()
        sent = 0

        def publish() -> None:
            nonlocal sent
            while not stop.wait(0.05):
                publisher.put(b"%d" % sent)
                sent += 1

        meet(publisher, heard)
        thread = threading.Thread(target=publish)
        thread.start()
        stack.callback(thread.join)
        stack.callback(stop.set)
        port = int(ward.endpoint.rpartition(":")[2])
        for _ in range(IDLE):
            stack.enter_context(socket.create_connection(("127.0.0.1", port)))
        ward.bus("viewer:v1").close()  # as yet nobody is in the way
        time.sleep(HANDSHAKE_S + 0.5)
        ZenohBus(ward.routers("viewer:v1"), open_timeout_s=60.0).close()  # and does not wait for ever
        stop.set()
        thread.join()
        got = [int(heard.receive(30.0).payload) for _ in range(sent)]  # type: ignore[union-attr] # all of them come
    assert got == list(range(sent))
    assert sent > 10
