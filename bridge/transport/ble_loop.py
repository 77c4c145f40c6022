"""The one thread in which everything of Bluetooth Low Energy happens, for all devices: an asyncio loop, begun when needed."""

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar

T = TypeVar("T")

NAME = "ble"
_begun = threading.Lock()
_loop: asyncio.AbstractEventLoop | None = None
#: BlueZ makes one connection at a time, and refuses the others
connecting = asyncio.Lock()


def run(work: Coroutine[Any, Any, T]) -> Future[T]:
    """Have the loop do this; from any other thread. Cancel the future to end it."""
    global _loop  # noqa: PLW0603 - one for the process
    with _begun:
        if _loop is None:
            _loop = asyncio.new_event_loop()
            threading.Thread(target=_loop.run_forever, name=NAME, daemon=True).start()
    return asyncio.run_coroutine_threadsafe(work, _loop)
