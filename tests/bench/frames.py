"""Whether a damaged frame of the native protocol is ever taken for a whole one: `python -m tests.bench.frames`.

A CRC-32 lets one of 2**32 random frames through: in 1e9 damaged ones 0.23 at most. What came through although it was damaged
is a wrong one.
"""

import argparse
import sys
import time

import numpy as np

from bridge.framing.deframer import Deframer, frame
from bridge.framing.packets import Data, encode_data

FRAMES = 10_000_000
RATES = (1e-3, 1e-4, 1e-5)
_AT_ONCE = 20_000


def tried(n: int, bit_errors: float, rng: np.random.Generator) -> tuple[int, int, int]:
    """Frames that were damaged, those lost of them, and wrong ones among what came through of n damaged frames.

    Each of the n has at least one flipped bit, and as many more as the error rate has it.
    """
    ones = np.ones((2, 3), np.float32)
    payload = encode_data(Data(7, 1, np.arange(2, dtype=np.uint32), ones, ones, ones[:, 0]))
    whole = np.frombuffer(frame(payload), np.uint8)
    lost = wrong = done = 0
    while done < n:
        m = min(_AT_ONCE, n - done)
        more = 1 + rng.binomial(8 * len(whole) - 1, bit_errors, m)
        frames = np.tile(whole, (m, 1))
        rows = np.repeat(np.arange(m), more)
        bits = rng.integers(0, 8 * len(whole), len(rows))
        np.bitwise_xor.at(frames, (rows, bits // 8), (1 << (bits % 8)).astype(np.uint8))
        payloads = Deframer().feed(frames.tobytes())
        # A frame whose flips met each other is whole again, and one split by a new zero is none.
        again = int((frames == whole).all(axis=1).sum())
        good = sum(got == payload for got in payloads)
        wrong += len(payloads) - good
        lost += m - again
        done += m
    return n, lost, wrong


def main() -> int:
    """Print what was tried and what came through."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=lambda text: int(float(text)), default=FRAMES)
    args = parser.parse_args()
    for rate in RATES:
        begun = time.monotonic()
        n, lost, wrong = tried(args.frames // len(RATES) + 1, rate, np.random.default_rng())
        print(
            f"bit errors {rate:g}: {n:,} damaged frames, {lost:,} lost, {wrong} wrong ones accepted; "
            f"by arithmetic {lost * 2.0**-32:.2g} at most ({time.monotonic() - begun:.0f} s)"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
