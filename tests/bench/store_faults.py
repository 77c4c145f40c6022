"""What becomes of a store: killed writers, failing calls of the kernel, torn files and flipped bits, as JSON and in a line.

python -m tests.bench.store_faults [--kills 200] [--flips 5000] [--calls 60] [--seed 1]

- kills: a process that writes calibrations is killed (SIGKILL) at a random moment; afterwards each acknowledged
  one must be in the store.
- torn: the file ends at each page, and in the midst of it. flips: one bit each, all of the header and more. With a backup the
  store must be as it was written, unharmed or restored; without one, unharmed or begun anew. Either is said.
- calls: the n-th write, sync or opening of a file fails (EIO, ENOSPC), by strace. What is acknowledged must be there, and
  the file sound.
"""

import argparse
import json
import logging
import multiprocessing
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from itertools import product
from pathlib import Path

from estimator.service.store import Store
from tests.estimator.database.damage import Damaged, flipped
from tests.estimator.database.kept import made
from tests.estimator.database.writing import write
from tests.estimator.stream import NAME

PAGE, HEADER = 4096, 100
#: what may not happen
BAD = ("lost", "wrong", "found damaged")


def kills(folder: Path, many: int, chance: random.Random) -> dict[str, int]:
    """Writers killed one after the other, at random moments, on one store."""
    path, acknowledged, lost, damaged = folder / "a.sqlite3", set[int](), 0, 0
    fork = multiprocessing.get_context("fork")  # else most of the time goes into loading NumPy
    for kill in range(many):
        ours, theirs = fork.Pipe(duplex=False)
        writer = fork.Process(target=write, args=(str(path), 1000 * kill, theirs.send))
        writer.start()
        theirs.close()
        ours.poll(60.0)
        time.sleep(chance.uniform(0.0, 0.3))
        writer.kill()  # whatever it is doing
        writer.join()
        with suppress(EOFError):
            while True:
                acknowledged.add(ours.recv())
        store = Store(path)
        lost += len(acknowledged - {c.boot for c in store.calibrations(NAME)})
        damaged += len(store.database.notes)
        store.close()
    return {"killed": many, "acknowledged": len(acknowledged), "lost": lost, "found damaged": damaged}


def judged(damaged: Damaged, files: Iterable[bytes], *, backup: bool) -> dict[str, int]:
    """What became of each; `wrong` where a damaged store was used."""
    found = Counter[str]()
    for data in files:
        try:
            found[damaged.judge(data, backup=backup)] += 1
        except AssertionError as error:
            found["wrong"] += 1
            print(f"wrong: {error}", file=sys.stderr)
    return dict(found)


def calls(folder: Path, most: int) -> dict[str, int]:
    """Sessions of which the n-th call of the kernel fails."""
    found = Counter[str]()
    for call, error, n in product(("pwrite64", "fdatasync", "openat"), ("EIO", "ENOSPC"), range(1, most + 1)):
        place = folder / f"{call}-{error}-{n}"
        place.mkdir(parents=True)
        path, trace = made(place), place / "trace"
        inject = ["strace", "-f", "-qq", "-o", str(trace), "-P", str(path), "-P", f"{path}-wal", "-P", f"{path}-shm"]
        inject += ["-e", f"trace={call}", "-e", f"inject={call}:error={error}:when={n}"]
        done = subprocess.run(
            [*inject, sys.executable, "-m", "tests.estimator.database.writing", str(path), "3", "8"],
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )
        acknowledged = {int(line) for line in done.stdout.splitlines()} | {1, 2, 3}
        store = Store(path)
        found["acknowledged"] += len(acknowledged)
        found["lost"] += len(acknowledged - {c.boot for c in store.calibrations(NAME)})
        found["found damaged"] += len(store.database.notes)
        found["written"] += len(done.stdout.split())
        found["ended by an error"] += done.returncode != 0
        found["injected"] += "INJECTED" in trace.read_text()
        store.close()
        shutil.rmtree(place)
    return dict(found)


def main() -> int:
    """Do all of it; 1 where something was lost, or a damaged store was used."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("kills", 200), ("flips", 5000), ("calls", 60), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    logging.disable()
    chance, found = random.Random(given.seed), dict[str, dict[str, int]]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "killed").mkdir()
        found["kills"] = kills(folder / "killed", given.kills, chance)
        (folder / "damaged").mkdir()
        damaged = Damaged(folder / "damaged")
        data = damaged.whole
        ends = [end + more for end in range(0, len(data), PAGE) for more in (0, 1, 100, 2000)]
        bits = [(byte, bit) for byte in range(HEADER) for bit in range(8)]
        bits += [(chance.randrange(len(data)), chance.randrange(8)) for _ in range(given.flips)]
        for backup in (True, False):
            how = "with a backup" if backup else "without"
            found[f"torn, {how}"] = judged(damaged, (data[:end] for end in ends), backup=backup)
            found[f"flips, {how}"] = judged(damaged, (flipped(data, *bit) for bit in bits), backup=backup)
        if shutil.which("strace"):
            found["calls"] = calls(folder / "calls", given.calls)
    print(json.dumps({"bytes": len(data), **found}, indent=2))
    bad = {what: n for of in found.values() for what, n in of.items() if what in BAD and n}
    print(
        f"of {given.kills} kills, {len(bits)} flips and {given.calls} calls of each kind that fail: {bad or 'all is well'}"
    )
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
