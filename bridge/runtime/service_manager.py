"""Messages to systemd that a service has started, is alive and is stopping, by the protocol sd_notify(3)."""

import contextlib
import os
import socket
import threading
from collections.abc import Callable, Iterator, Sequence


@contextlib.contextmanager
def supervised(sick: Callable[[], Sequence[str]] = list) -> Iterator[None]:
    """Tell systemd that the service is ready, then send watchdog messages while `sick()` is empty, in a `with` block.

    sick: returns the faults due to which the process counts as not alive, as texts; called on a separate thread.
    Without systemd, nothing is sent.
    At the end of the block, systemd is told that the service stops. Protocol: sd_notify(3).
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        yield
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.connect(address.replace("@", "\0", 1) if address.startswith("@") else address)
        manager.send(b"READY=1")
        stop = threading.Event()
        feeder = threading.Thread(target=_feed, args=(manager, sick, stop), name="watchdog", daemon=True)
        if os.environ.get("WATCHDOG_USEC"):
            feeder.start()
        try:
            yield
        finally:
            stop.set()
            with contextlib.suppress(OSError):
                manager.send(b"STOPPING=1")
            if feeder.ident is not None:
                feeder.join()


def _feed(manager: socket.socket, sick: Callable[[], Sequence[str]], stop: threading.Event) -> None:
    every_s = int(os.environ["WATCHDOG_USEC"]) / 3e6
    while not stop.wait(every_s):
        if not sick():
            with contextlib.suppress(OSError):
                manager.send(b"WATCHDOG=1")
