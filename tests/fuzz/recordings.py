"""Damaged tables of text, drawn: `python -m tests.fuzz.recordings 1000000`. Only RecordingError may come, and soon."""

import logging
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from bridge.recording import Reading, RecordingError, load

#: seconds that one small file may take
_SOON_S = 5.0
_SAID_EVERY_S = 10.0
_N = 60
_T = np.arange(_N) / 50


def _rows(separator: str, form: str = "%.5f", scale: float = 1.0) -> str:
    table = np.column_stack([_T * scale, np.random.default_rng(0).normal(size=(_N, 6))])
    return "\n".join(separator.join(form % value for value in row) for row in table) + "\n"


SEEDS = [
    ("t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + _rows(",")).encode(),
    ("# rate: 50 Hz\n# gyro: deg/s\ngx;gy;gz;ax;ay;az;temp\n" + _rows(";").replace(".", ",")).encode("utf-16"),
    (
        "Time;Gyroscope;;;Accelerometer;;\n;X;Y;Z;X;Y;Z\nms;rad/s;rad/s;rad/s;g;g;g\n" + _rows(";", "%.6E", 1000.0)
    ).encode(),
    ("timestamp gyro_x gyro_y gyro_z acc_x acc_y acc_z\n" + _rows(" ", "%9.4f", 1e6)).encode(),
    b"time\tx (deg/s)\ty (deg/s)\tz (deg/s)\n"
    + b"".join(b"2024-05-01 10:00:%06.3f\t1.5\t2.5\t%.3f\n" % (one, one) for one in _T),
    b"sep=,\nPacketCounter,Gyr_X,Gyr_Y,Gyr_Z,\n" + b"".join(b"%d,1,%d,3,\n" % (65500 + i, i) for i in range(_N)),
    "".join(
        f"ACCE;{t:.3f};0.1;0.2;9.8\nGYRO;{t:.3f};{g}\n" for t, g in zip(_T, _rows(";").splitlines(), strict=True)
    ).encode(),
]
_ODD = [
    b"1e308",
    b"-1e308",
    b"nan",
    b"inf",
    b"",
    b"1e-320",
    b"9" * 40,
    b"0x1F",
    b"1_0",
    b'"',
    b"\0",
    b"\xff",
    b"#",
    b"\r",
]
_READINGS = [
    Reading(),
    Reading(gyro_unit="deg/s", rate_hz=50.0),
    Reading(gyro_sensitivity=131.0, time_unit="ms"),
    Reading(columns=("2", "3", "4"), gyro_unit="rad/s", time_column="1"),
    Reading(rate_hz=1.0, boot=1),
]


def damaged(rng: np.random.Generator) -> bytes:
    """A seed with some damage."""
    data = SEEDS[rng.integers(len(SEEDS))]
    for _ in range(rng.integers(1, 6)):
        lines = data.split(b"\n")
        at, to = sorted(rng.integers(0, max(1, len(data)), 2).tolist())
        row = int(rng.integers(len(lines)))
        match rng.integers(9):
            case 0:
                data = data[:at] + bytes(rng.integers(0, 256, 1, np.uint8)) + data[at + 1 :]
            case 1:
                data = data[:at] + data[to:]
            case 2:
                data = data[:to] + data[at:]
            case 3:
                data = b"\n".join([*lines[:row], *lines[row : row + 5], *lines[row:]])
            case 4:
                cells = lines[row].replace(b";", b",").split(b",")
                cells[rng.integers(len(cells))] = _ODD[rng.integers(len(_ODD))]
                data = b"\n".join([*lines[:row], b",".join(cells), *lines[row + 1 :]])
            case 5:
                data = data.replace(b",", [b";", b"\t", b" ", b",,"][rng.integers(4)], int(rng.integers(1, 500)))
            case 6:
                data = data[:at]
            case 7:
                data = data + SEEDS[rng.integers(len(SEEDS))]
            case _:
                data = b"\n".join(lines[i] for i in rng.permutation(len(lines)))
    return data


def main(runs: int) -> None:
    """Raises what the reader raises beside RecordingError, after the input that did it."""
    logging.disable(logging.CRITICAL)
    rng = np.random.default_rng()
    read, begun, said, slowest = 0, time.monotonic(), time.monotonic(), 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fuzz.csv"
        for done in range(1, runs + 1):
            data = damaged(rng)
            path.write_bytes(data)
            before = time.monotonic()
            try:
                load(path, reading=_READINGS[rng.integers(len(_READINGS))])
                read += 1
            except RecordingError:
                pass
            except BaseException:
                print(data.hex(), file=sys.stderr)
                raise
            spent = time.monotonic() - before
            slowest = max(slowest, spent)
            if spent > _SOON_S:
                print(data.hex(), file=sys.stderr)
                raise TimeoutError(f"{spent:.1f} s")
            if time.monotonic() - said > _SAID_EVERY_S or done == runs:
                said = time.monotonic()
                memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                print(
                    f"{done:,} files, {read:,} read, {done / (said - begun):,.0f} a second, slowest {slowest:.2f} s, "
                    f"{memory_mb:.0f} MB at most",
                    flush=True,
                )


if __name__ == "__main__":
    main(int(float(sys.argv[1])))
