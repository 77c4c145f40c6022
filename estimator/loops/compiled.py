"""Loops over samples as machine code: compiled by Numba when they are first called, and kept beside the source.

A step of an array of some hundred numbers costs NumPy more for its call than for its arithmetic, and a second of one device has
hundreds of them. What is compiled is plain loops over floats and arrays, each with the source of its mathematics; it gives the
same bits in any batching. Numba is imported late: a program that is restarted has other things to do first.
"""

import contextlib
import functools
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

log = logging.getLogger(__name__)

#: an index out of bounds is an IndexError, as in Python: it costs a twentieth
_SAFE: dict[str, Any] = {"error_model": "numpy", "boundscheck": True}
_BLAS = "scipy.linalg.cython_blas"
_lock = threading.RLock()
_all: list[Callable[[], Any]] = []
_told = False


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
        def call(*args: Any) -> Any:  # none comes by its name, which takes longer
            return (made or make())(*args)

        _all.append(make)
        return call  # type: ignore[return-value]

    return of


def ready() -> None:
    """Have all loops at hand: seconds on the first start on a machine, a fraction of one later."""
    _load()
    with _without_blas():
        for make in _all:
            make()


@contextlib.contextmanager
def _without_blas() -> Iterator[None]:
    """Numba looks for scipy's BLAS, which no loop here needs: loading it is a sixth of the time until an estimator is back.

    For who is about to start: another thread that loads scipy meanwhile would not find it either.
    """
    if _BLAS in sys.modules:
        yield
        return
    sys.modules[_BLAS] = None  # type: ignore[assignment] # as Python has it: there is none
    try:
        yield
    finally:
        sys.modules.pop(_BLAS, None)


def kept() -> str | None:
    """The folder where loops are kept for the next start; None where there is none that may be written to."""
    _load()
    stats = _all[0]().stats
    return stats.cache_path if stats.cache_hits or stats.cache_misses else None


def _load() -> None:
    package = __name__.rpartition(".")[0]
    for module in iter_modules(import_module(package).__path__):
        if not module.name.startswith("_"):
            import_module(f"{package}.{module.name}")


def _made(function: Callable[..., Any], signature: str) -> Any:
    from numba import njit  # noqa: PLC0415
    from numba.core.errors import NumbaError  # noqa: PLC0415

    from estimator.loops._kept import Kept  # noqa: PLC0415

    def keep() -> Any:
        made = njit(**_SAFE)(function)
        made._cache = Kept(function)  # noqa: SLF001 - where cache=True puts one of Numba's own
        made.compile(signature)
        made.disable_compile()
        return made

    try:
        made = keep()
    except NumbaError:
        raise
    except Exception as error:  # noqa: BLE001 - no place to keep it, or what was kept is damaged: neither has a type of its own
        try:
            Kept(function).flush()
            made = keep()
        except Exception:  # noqa: BLE001 - as above
            log.warning("%s is compiled anew at every start (%s)", function.__name__, error)
            return njit(signature, **_SAFE)(function)
        log.warning("%s is compiled anew: what was kept of it is damaged (%s)", function.__name__, error)
    if not made.stats.cache_hits:
        _tell()
    return made


def _tell() -> None:
    """Why it takes seconds, once."""
    global _told  # noqa: PLW0603
    if not _told:
        _told = True
        log.info("compiling for this machine, up to a minute; the next start finds it done")
