"""Machine code on disk under a seal: Numba runs whatever it finds there, and a page that a power cut left empty is a crash."""

import pickle
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba.core import caching as numba_caching
from numba.core.runtime import nrt as numba_runtime

caching: Any = numba_caching  # neither has types
runtime: Any = numba_runtime

_SEAL = sha256().digest_size


class Damaged(Exception):
    """What was kept is not what was written."""


class Kept(caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        impl = self._impl
        self._cache_file = _Sealed(self._cache_path, f"{impl.filename_base}.sealed", impl.locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """As Numba's own, but without loading first what only compiling needs: a sixth of the time until an estimator starts."""
        runtime.rtsys.initialize(target_context)
        return self._load_overload(sig, target_context)


class _Sealed(caching.IndexDataCacheFile):  # type: ignore[misc]
    """Its files: what is loaded as code begins with its SHA-256."""

    def _save_data(self, name: str, data: Any) -> None:
        code = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(sha256(code).digest() + code)

    def _load_data(self, name: str) -> Any:
        kept = Path(self._data_path(name)).read_bytes()
        if sha256(kept[_SEAL:]).digest() != kept[:_SEAL]:
            raise Damaged(f"{name} is not as it was written")
        return pickle.loads(kept[_SEAL:])  # noqa: S301 - our own, as its seal shows
