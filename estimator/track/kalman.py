"""filterpy's filter and smoother, without waiting for what the rest of filterpy imports.

That is most of scipy: half of the time in which an estimator starts, while a ward waits for one that was ended. It is imported
when something of it is called, by filterpy or by whoever uses filterpy beside us; so is what is called as `scipy.part.name`.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray


class _Late:
    """Something of a module, by its path in there. Until the module may be imported calling it does nothing."""

    def __init__(self, module: "_LateModule", path: str) -> None:
        self._module, self._path = module, path

    def __getattr__(self, name: str) -> "_Late":
        return _Late(self._module, f"{self._path}.{name}")

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        if not self._module.wanted:
            return None  # filterpy tries one out while it is imported
        found: Any = import_module(self._module.__name__)
        for name in self._path.split("."):
            found = getattr(found, name)
        return found(*args, **kwargs)


class _LateModule(ModuleType):
    wanted = False

    def __getattr__(self, name: str) -> _Late:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Late(self, name)


@contextmanager
def _later(*names: str) -> Iterator[None]:
    """What is imported in here, and imports modules of these names, will import them when it uses them."""
    late = {name: _LateModule(name) for name in names if name not in sys.modules}
    sys.modules.update(late)
    try:
        yield
    finally:
        for name, module in late.items():
            del sys.modules[name]
            module.wanted = True


with _later("scipy.linalg", "scipy.ndimage", "scipy.sparse", "scipy.sparse.linalg", "scipy.stats"):
    from filterpy.kalman import KalmanFilter, kalman_filter, rts_smoother


def _kept(measured: Any) -> Any:
    """A copy of a measurement, as filterpy keeps the last one: of an array deepcopy takes four times as long."""
    return measured.copy() if type(measured) is np.ndarray else deepcopy(measured)


kalman_filter.deepcopy = _kept
#: the same dot, which does not ask first whether an operand has one of its own: a third of what it takes for small arrays
kalman_filter.dot = getattr(np.dot, "_implementation", np.dot)


@cache
def _identity(n: int) -> NDArray[np.float64]:
    return np.eye(n)


class Bare(KalmanFilter):  # type: ignore[misc]
    """A filter of n states that keeps little but those: of a thousand, most of a processor's cache goes to copies otherwise."""

    Q: Any

    def __init__(self, n: int) -> None:
        super().__init__(dim_x=n, dim_z=3)
        self.F = self._I = _identity(n)

    def let_go(self) -> None:
        """Of what was added in a step, and of the copies of P."""
        self.Q = self.P_prior = self.P_post = None


__all__ = ["Bare", "KalmanFilter", "rts_smoother"]
