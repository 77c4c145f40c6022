"""Thread for Bluetooth Low Energy, shared by all devices: an asyncio loop, started when needed."""

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar

T = TypeVar("T")

NAME = "ble"
_begun = threading.Lock()
_loop: asyncio.AbstractEventLoop | None = None
#: held while a connection is made: BlueZ makes one at a time and refuses others
connecting = asyncio.Lock()


def run(work: Coroutine[Any, Any, T]) -> Future[T]:
    """Run a coroutine in the thread for BLE, and return its future; callable from any other thread.

    Cancelling the future cancels the coroutine.
    """
    global _loop  # noqa: PLW0603 - one loop per process
    with _begun:
        if _loop is None:
            _loop = asyncio.new_event_loop()
            threading.Thread(target=_loop.run_forever, name=NAME, daemon=True).start()
    return asyncio.run_coroutine_threadsafe(work, _loop)
