"""The C program of `embedded/`, built for this machine with sanitizers."""

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SOURCE = Path(__file__).parents[2] / "embedded"
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror"]
SENSITIVITY = float(np.float32(np.radians(0.0175)))  # of a gyroscope with ±500 °/s
STILL_STD = 0.00436  # 0.25 °/s: five times the noise
OK = 4
BOOT, SEQUENCE = 0xA10000B200C30004, 0x00010200
Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Found:
    status: int
    k: NDArray[np.float64]
    bias: NDArray[np.float64]
    packet: bytes = b""


def build(folder: Path) -> Path:
    """The program, built in a folder. Raises CalledProcessError."""
    built = folder / "host"
    sanitizers = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    subprocess.run(
        ["gcc", *STRICT, *sanitizers, SOURCE / "gyro_turns.c", SOURCE / "host.c", "-lm", "-o", built], check=True
    )
    return built


def run(program: Path, counts: Counts, rate_hz: float, sensitivity: float = SENSITIVITY) -> Found:
    lines = [f"{rate_hz!r} {sensitivity!r} {STILL_STD!r}", *(f"{x} {y} {z}" for x, y, z in counts.tolist())]
    given = [str(BOOT), str(SEQUENCE)]
    done = subprocess.run([program, *given], input="\n".join(lines), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    words = done.stdout.split()
    return Found(int(words[0]), np.array(words[1:4], float), np.array(words[4:7], float), bytes.fromhex(words[-1]))


def counted(gyro: NDArray[np.float64], sensitivity: float = SENSITIVITY) -> Counts:
    return np.clip(np.rint(gyro / sensitivity), -32768, 32767).astype(np.int64)
