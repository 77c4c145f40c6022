"""Decorator for Numba-compiled loops: compiled on the first call, and cached on disk.

The cache is beside the source, or in NUMBA_CACHE_DIR. Compiled loops replace hundreds of small NumPy calls, which cost
more than their arithmetic. Numba is imported on the first call, because its import takes half a second.
"""

import functools
import logging
from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
P = ParamSpec("P")
R = TypeVar("R")

log = logging.getLogger(__name__)

#: an index out of bounds raises IndexError, as in Python; the check costs 5 % of the time
_SAFE: dict[str, Any] = {"error_model": "numpy", "boundscheck": True}
_makers: list[Callable[[], Any]] = []


def compiled(signature: str, *steps: Callable[..., Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator that compiles a function for one signature in Numba's notation.

    The compiled function takes its arguments by position only.
    steps: functions of the same file that the function calls; they are compiled into it.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        make = functools.cache(functools.partial(_compile, function, signature, steps))

        @functools.wraps(function)
        def call(*args: Any) -> Any:
            return make()(*args)

        _makers.append(make)
        return call  # type: ignore[return-value]

    return decorate


def ready() -> None:
    """Load all compiled loops, or compile them on a machine's first start.

    Compiling takes up to a minute, loading less than a second.
    """
    _load()
    for make in _makers:
        make()


def cache_folder() -> str | None:
    """Folder where compiled loops are cached; None where Numba finds no writable folder."""
    _load()
    stats = _makers[0]().stats
    return str(stats.cache_path) if stats.cache_hits or stats.cache_misses else None


def _load() -> None:
    package = __name__.rpartition(".")[0]
    for module in iter_modules(import_module(package).__path__):
        if not module.name.startswith("_"):
            import_module(f"{package}.{module.name}")


def _compile(function: Callable[..., Any], signature: str, steps: tuple[Callable[..., Any], ...]) -> Any:
    from numba import njit  # noqa: PLC0415 - see above
    from numba.extending import register_jitable  # noqa: PLC0415

    for step in steps:
        register_jitable(**_SAFE)(step)

    try:
        made = njit(signature, cache=True, **_SAFE)(function)
    except Exception as error:  # noqa: BLE001 - no folder to cache in, or a damaged file there: neither has a type of its own
        log.warning("%s cannot be cached and is compiled at every start: %s", function.__name__, error)
        return njit(signature, **_SAFE)(function)
    if made.stats.cache_misses:
        log.info("compiled %s for this machine; the next start uses the cached result", function.__name__)
    return made
