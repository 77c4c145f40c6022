"""Time and memory of reading a million rows of text: `python -m tests.bench.reading`."""

import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from bridge.recording import load

ROWS = 1_000_000


def main() -> None:
    """Print processor time, wall time, and peak memory beside that of the arrays."""
    table = np.column_stack([np.arange(ROWS) / 100, np.random.default_rng(0).normal(size=(ROWS, 6))])
    with tempfile.TemporaryDirectory() as folder:
        small, path = Path(folder) / "small.csv", Path(folder) / "rows.csv"
        header = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"
        for out, rows in ((small, table[:100]), (path, table)):
            np.savetxt(out, rows, fmt="%.6f", delimiter=",", header=header, comments="")
        del table
        load(small)
        before = _peak_mb()
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        recording = load(path)
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        accel = recording.accel
        arrays = recording.time_s.nbytes + recording.gyro.nbytes + (0 if accel is None else accel.nbytes)
        size_mb = path.stat().st_size / 1e6
        print(f"{len(recording):,} rows, {size_mb:.0f} MB: {cpu_s:.2f} s of processor, {wall_s:.2f} s by the clock")
        print(f"peak {_peak_mb() - before:.0f} MB more than before, the arrays have {arrays / 1e6:.0f} MB")


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
