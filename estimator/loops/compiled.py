"""Loops over samples as machine code: compiled by Numba when they are first called, and kept beside the source.

A step of an array of some hundred numbers costs NumPy more for its call than for its arithmetic, and a second of one device has
hundreds of them. What is compiled is plain loops over floats and arrays, each with the source of its mathematics; it gives the
same bits in any batching. Numba is imported late: a program that is restarted has other things to do first.
"""

import functools
import logging
import threading
import time
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

log = logging.getLogger(__name__)

#: s, who waits longer than this is told why
_PATIENCE_S = 2.0
_lock = threading.RLock()
_all: list[Callable[[], object]] = []


def compiled(signature: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """The same function as machine code of this signature (Numba's language); division by zero gives what it does in NumPy."""

    def of(function: Callable[P, R]) -> Callable[P, R]:
        made: Any = None

        def make() -> Any:
            nonlocal made
            with _lock:
                if made is None:
                    made = _made(function, signature)
            return made

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            return (made or make())(*args, **kwargs)  # type: ignore[no-any-return]

        _all.append(make)
        return call

    return of


def ready() -> None:
    """Compile, or load, all that is known by now: seconds on the first start on a machine, a fraction of one later."""
    for make in _all:
        make()


def _made(function: Callable[..., Any], signature: str) -> Any:
    from numba import njit  # noqa: PLC0415
    from numba.core.errors import NumbaError  # noqa: PLC0415

    begun = time.monotonic()
    try:
        made = njit(signature, cache=True, error_model="numpy")(function)
    except NumbaError:
        raise
    except Exception:  # noqa: BLE001 - no place to keep it, or what was kept is damaged; numba does not say which by type
        made = njit(signature, error_model="numpy")(function)
    if time.monotonic() - begun > _PATIENCE_S:
        log.info("%s was compiled for this machine; next time it is at hand", function.__qualname__)
    return made
