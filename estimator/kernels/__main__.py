"""`python -m estimator.kernels`: compile all loops for this machine ahead of the first start."""

import sys
from time import monotonic

from estimator.kernels.compiled import cache_folder, ready

if __name__ == "__main__":
    print("compiling for this machine, up to a minute …", flush=True)
    begun = monotonic()
    folder = cache_folder()
    if folder is None:
        sys.exit(
            "no folder for the compiled kernels: set NUMBA_CACHE_DIR to a writable folder, also where truerate runs"
        )
    ready()
    print(f"done in {monotonic() - begun:.1f} s, kept in {folder}")
