"""`python -m estimator.loops`: compile all loops for this machine, so that the first start need not."""

import sys
from time import monotonic

from estimator.loops.compiled import kept, ready

if __name__ == "__main__":
    print("compiling for this machine, up to a minute …", flush=True)
    begun, folder = monotonic(), kept()
    if folder is None:
        sys.exit("nowhere to keep it: set NUMBA_CACHE_DIR to a folder that truerate may write to, also where it runs")
    ready()
    print(f"done in {monotonic() - begun:.1f} s, kept in {folder}")
