"""What becomes of a store: killed writers, failing calls of the kernel, torn files and flipped bits. Prints one JSON object.

python -m tests.bench.store_faults [--kills 200] [--flips 5000] [--calls 60] [--devices 100] [--seed 1]

- kills: a process that writes calibrations is killed (SIGKILL) at a random moment; afterwards each acknowledged
  one must be in the store.
- torn: the file ends at each page, and in the midst of it. flips: one bit each, all of the header and more. With a backup the
  store must be as it was written, unharmed or restored; without one, unharmed or begun anew. Either is said.
- calls: the n-th write, sync or opening of a file fails (EIO, ENOSPC), by strace. What is acknowledged must be there, and
  the file sound.
- a year: what opening and backing up a store of a year costs.
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

from estimator.database import back_up, inspect
from estimator.service.store import Store
from tests.estimator.database.damage import Damaged, flipped
from tests.estimator.database.kept import made
from tests.estimator.database.writing import write
from tests.estimator.stream import NAME

PAGE, HEADER = 4096, 100
#: points of a year, thinned: a minute apart for a week, an hour until three months, then a day
YEAR = 7 * 1440 + 83 * 24 + 275

SESSION = """
import sys, time
from dataclasses import replace
from estimator.service import clerk
from estimator.database import back_up, inspect
from estimator.service.store import Store
from tests.estimator.database.kept import CALIBRATIONS, bias
clerk.RETRY_S = 0.01
store = Store(sys.argv[1], patient=True)
writer = clerk.Clerk(store.database)
for n in range(4, 12):
    c = replace(CALIBRATIONS[0], id=f"k{n}", boot=n, time_ns=n)
    writer.do(lambda c=c: store.add_calibration(c), lambda error, n=n: error is None and print(n, flush=True))
    writer.do(lambda n=n: store.save_bias("chest", n, n, bias(n), history=True))
    time.sleep(0.02)
    writer.collect()
store.database.back_up_if_due()
writer.close()
store.close()
"""


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
            [*inject, sys.executable, "-c", SESSION, str(path)],
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
        found["ended by an error"] += done.returncode != 0
        found["injected"] += "INJECTED" in trace.read_text()
        store.close()
        shutil.rmtree(place)
    return dict(found)


def year(folder: Path, devices: int, points: int) -> dict[str, float]:
    """What a store of so many devices, with so many points of bias history each, costs: seconds of processor time."""
    path = folder / "a.sqlite3"
    store, columns = Store(path), "device, boot, time_ns, x, y, z, x_std, y_std, z_std, temperature_c"
    add = f"INSERT INTO bias_history ({columns}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
    for point in range(points):
        with store.database.transaction():
            for device in range(devices):
                numbers = (0.001 * ((device * 7 + point * n) % 997) for n in range(1, 8))
                store.database.execute(add, (f"device-{device:03}", "1", point * 60 * 10**9, *numbers))
    store.close()
    found: dict[str, float] = {"points": devices * points, "megabytes": path.stat().st_size / 1e6}
    begun = time.process_time()
    found["sound"] = inspect(path).sound
    found["check, s"] = time.process_time() - begun
    begun = time.process_time()
    back_up(path, folder / "copy.sqlite3")
    found["backup, s"] = time.process_time() - begun
    return found


def main(words: list[str] | None = None) -> None:
    """Do all of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("kills", 200), ("flips", 5000), ("calls", 60), ("devices", 100), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args(words)
    logging.disable()
    chance, found = random.Random(given.seed), dict[str, object]()
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
        (folder / "year").mkdir()
        found["a year"] = year(folder / "year", given.devices, YEAR)
        if shutil.which("strace"):
            found["calls"] = calls(folder / "calls", given.calls)
    print(json.dumps({"bytes": len(data), **found}, indent=2))


if __name__ == "__main__":
    main()
