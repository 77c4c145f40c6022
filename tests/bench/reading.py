"""Time and memory of reading a million rows of text: `python -m tests.bench.reading`."""

import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from bridge.recording import load

ROWS = 1_000_000
_PART = 10_000


def main() -> None:
    """Print processor time, wall time, and peak memory beside that of the arrays."""
    with tempfile.TemporaryDirectory() as folder:
        small, path = Path(folder) / "small.csv", Path(folder) / "rows.csv"
        _write(small, 100)
        _write(path, ROWS)
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


def _write(path: Path, rows: int) -> None:
    """Write rows in parts, so that the peak of this process is the reader's."""
    random = np.random.default_rng(0)
    with path.open("w") as file:
        file.write("t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n")
        for start in range(0, rows, _PART):
            time_s = np.arange(start, min(rows, start + _PART)) / 100
            np.savetxt(file, np.column_stack([time_s, random.normal(size=(len(time_s), 6))]), fmt="%.6f", delimiter=",")


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
