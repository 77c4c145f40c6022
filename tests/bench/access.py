"""Every role × kind of key, 100,000 samples a cell, through a router with rules: what passes, what does not.

    python -m tests.bench.access [--count 100000]

Exit code 1 where a cell is not as it has to be.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from tests.bridge.pki import cells
from tests.bridge.pki.guarded_ward import MEMBERS, GuardedWard


def judged(found: cells.Counts, expected: cells.Counts) -> tuple[int, int, int]:
    """Samples that are missing, too many, and where none may come: what is too much in one cell makes up for no other's lack."""
    too_many = found - expected
    leaked = sum(count for cell, count in too_many.items() if not expected[cell])
    return (expected - found).total(), too_many.total() - leaked, leaked


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000)
    count = parser.parse_args().count
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        ward = GuardedWard(Path(folder) / "pki", (*MEMBERS, cells.WITNESS))
        with ward.running():
            for what, tried, may in (
                ("published", cells.published, cells.MAY_SAY),
                ("heard", cells.heard, cells.MAY_HEAR),
                ("asked for its history", cells.asked, cells.MAY_LOOK_BACK),
            ):
                each = min(count, 2000) if what.startswith("asked") else count  # as much as a cache is for
                began = time.monotonic()
                found, expected = tried(ward, each), cells.expected(may, each)
                took = time.monotonic() - began
                all_cells = [(who, kind) for who in MEMBERS for kind in cells.KEYS]
                allowed = [cell for cell in all_cells if expected[cell]]
                short, twice, leaked = judged(found, expected)
                wrong += bool(short or twice or leaked)
                print(
                    f"{what}: {len(all_cells)} cells × {each}; {len(allowed)} allowed,"
                    f" {short} samples of them missing, {twice} too many;"
                    f" {len(all_cells) - len(allowed)} denied, {leaked} samples of them came through; {took:.0f} s",
                    flush=True,
                )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
