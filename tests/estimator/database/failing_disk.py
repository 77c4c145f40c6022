"""A service's session lived on a disk whose n-th change fails, for every n asked for: one fork each, one line of JSON each.

`python -m tests.estimator.database.failing_disk SHIM FOLDER` with SHIM, failing_disk.c compiled, preloaded; what to try comes
on standard input, a line each: `first many errno`. Prints first how many changes the disk of a session without failures sees.
"""

import ctypes
import json
import os
import shutil
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.wire import codec, keys
from bridge.wire.messages import Quality
from estimator.config import Estimator
from estimator.database import inspect
from estimator.database.database import Database
from estimator.service import shell
from estimator.service.shell import Service
from estimator.service.store import Store
from estimator.service.vitals import Vitals
from tests.estimator.database.kept import loaded, made
from tests.estimator.stream import NAME, Stream, calibration, info

WARD, BOOT = "w", 9
#: seconds after which a disk that has begun to fail is repaired, and how long a session goes on, or goes on after that
REPAIRED_S, AFTER_S = 15.0, 20.0


def lived(disk: ctypes.CDLL, folder: Path, stream: Stream, first: int, many: int, error: int) -> dict[str, object]:
    """One session, on a store that holds older calibrations; what came of it."""
    path = folder / "life.sqlite3"
    shutil.copy(folder / "a.sqlite3", path)
    before = _kept(path)
    now = [0.0]
    shell.time = _Clock(lambda: now[0])  # type: ignore[attr-defined, assignment]
    broker, vitals = MemoryBroker(), Vitals(clock=lambda: now[0])
    bridge, ours = MemoryBus(broker), MemoryBus(broker)
    raw = bridge.publisher(keys.build(WARD, "raw", bridge="bridge", device=NAME))
    told = bridge.publisher(keys.build(WARD, "info", bridge="bridge", device=NAME))
    heard = {what: ours.subscribe(keys.pattern(WARD, what)) for what in ("corrected", "calibration", "status")}
    disk.disk_watch(b"life.sqlite3")
    disk.disk_fail(first, many, error)
    store = Store(Database(path, patient=True, clock=lambda: now[0]))
    settings = Estimator(id="e", store=str(path), silence_s=5.0)
    service = Service(
        WARD, settings, MemoryBus(broker), MemoryBus(broker), store, lambda: int(1e18 + 1e9 * now[0]), vitals
    )
    told.put(codec.encode_info(info(BOOT)))
    batches = stream.batches(boot=BOOT)
    unready, troubled = 0, 0
    at, until_s, failing_s = 0, len(batches) / 11 + AFTER_S, 0.0
    while now[0] < until_s:  # a second or so a round
        for batch in batches[at : at + 11]:
            raw.put(codec.encode_samples(batch))
        at += 11
        now[0] += 1.0
        if first and not failing_s and disk.disk_calls() >= first:
            failing_s = now[0]
            until_s = max(until_s, failing_s + REPAIRED_S + AFTER_S)
        if failing_s and now[0] > failing_s + REPAIRED_S:
            disk.disk_fail(0, 0, 0)
        while service.step(0.0):
            pass
        unready += bool(vitals.unready())
        troubled += bool(service._record.trouble)
    session = service._devices[NAME].session
    status = session.status(0)
    said = [codec.decode_calibration(*message).id for message in heard["calibration"].drain(100, 0.0)]
    rates = [codec.decode_corrected(*message) for message in heard["corrected"].drain(10_000, 0.0)]
    counts = service.counts.as_dict()
    service._record.close()
    changes = disk.disk_calls()
    store.close()
    again = Store(path)
    ids = [c.id for c in again.calibrations(NAME)]
    remembered = again.recall(NAME, BOOT, 0)
    again.close()
    return {
        "changes": changes,
        "all samples corrected": sum(map(len, rates)) == len(stream) == status.samples_out,
        "good in the end": rates[-1].quality is Quality.GOOD,
        "calibration said": said[-1:] == [rates[-1].calibration] and len(set(said)) == len(said),
        "calibration kept": rates[-1].calibration in ids,
        "bias kept": remembered is not None and remembered.bias is not None,
        "the old ones are there": before <= _kept(path),
        "store sound": inspect(path).sound,
        "works in the end": not service._record.trouble and not unready_now(vitals),
        "troubled": troubled,
        "unready": unready,
        "store failed": counts.get("store failed", 0),
        "sessions failed": counts.get("sessions failed", 0),
    }


def unready_now(vitals: Vitals) -> list[str]:
    """Why it is not ready, but for the device, which has said all it had to."""
    return [why for why in vitals.unready() if "device" not in why]


def _kept(path: Path) -> set[bytes]:
    store = Store.reading(path)
    found = {codec.encode_calibration(c) for c in store.calibrations(NAME)}
    assert loaded(store)
    store.close()
    return found


class _Clock:
    """`time`, with a monotonic clock of the test's own."""

    def __init__(self, monotonic: Callable[[], float]) -> None:
        self.monotonic = monotonic


def main(shim: str, folder: str) -> None:
    """Live once without a failure, and then once for each line."""
    disk = ctypes.CDLL(shim)
    disk.disk_fail.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_int]
    disk.disk_calls.restype = ctypes.c_long
    stream = calibration(seed=1)
    made(Path(folder))
    for line in ["0 0 0", *sys.stdin]:
        first, many, error = map(int, line.split())
        child = os.fork()
        if not child:
            part = Path(folder) / f"{first}-{many}-{error}"
            part.mkdir()
            shutil.copy(Path(folder) / "a.sqlite3", part)
            try:
                found = lived(disk, part, stream, first, many, error)
                print(json.dumps({"tried": [first, many, error]} | found), flush=True)  # noqa: T201
            except BaseException:  # noqa: BLE001 - its parent goes on
                traceback.print_exc()
                os._exit(1)
            shutil.rmtree(part)
            os._exit(0)
        if os.waitpid(child, 0)[1]:
            sys.exit(f"{line.strip()}: the session failed")


if __name__ == "__main__":
    main(*sys.argv[1:])
