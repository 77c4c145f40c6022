"""One seed: a ward is begun, tormented as planned, left alone for a while, and held against what was promised."""

import pickle
import shutil
import tempfile
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from estimator.demo import DemoFailed
from tests.nemesis.clock import Clock
from tests.nemesis.faults import Planned, plan
from tests.nemesis.field import Field
from tests.nemesis.history import Done
from tests.nemesis.invariants import broken

#: what is promised: whatever happened, so long after it every device is heard again
RECOVERED_S = 5.0
_BEGUN_S, _QUIET_S = 90.0, 2 * RECOVERED_S


@dataclass(slots=True)
class Result:
    """Faults done, corrected samples heard, those of them GOOD, those told missing, and the promises that were broken."""

    faults: list[str]
    sorts: list[str]
    samples: int
    good: int
    missing: int
    calibrations: int
    broken: list[str]
    #: logs, store and history, where something was broken
    folder: Path | None


def run(seed: int, devices: int, lasts_s: float, estimators: int = 1, routers: int = 1) -> Result:
    """Torment one ward."""
    kept: Path | None = None
    folder = Path(tempfile.mkdtemp(prefix="nemesis-"))
    try:
        clock = Clock.found(folder)
        with Field(folder, devices, seed, clock, estimators, routers) as field:
            listener = field.begin()
            deadline = time.monotonic() + _BEGUN_S
            while listener.history.calibrated < devices and time.monotonic() < deadline:
                time.sleep(0.05)
            found = [] if listener.history.calibrated >= devices else ["not every device was calibrated at first"]
            many = {"estimators": estimators, "routers": routers}
            planned = plan(seed, field.names, lasts_s, clocks=clock is not None, **many)
            torment(field, planned, listener.history.done)
            time.sleep(_QUIET_S)
            try:
                field.ward.check()
            except DemoFailed as error:
                found.append(str(error))
            for device in field.devices.values():
                device.power_off()
            end_s = time.monotonic()
            while not listener.has_all() and time.monotonic() < end_s + 30.0:
                time.sleep(0.05)
            time.sleep(2.5)  # one more status
            history = listener.close()
            history.end_s = end_s
            field.ward.close()
            found += broken(history, field.truth, RECOVERED_S) + field.complaints()
        told = [f"{done.what} ({done.end_s - done.begin_s:.1f} s)" for done in history.done]
        missing = sum(miss.count for miss in history.misses)
        if found:
            (folder / "history.pickle").write_bytes(pickle.dumps(history))
        kept = folder if found else None
        return Result(
            told,
            [one.sort for one in planned],
            history.samples,
            history.good,
            missing,
            len(history.calibrations),
            found,
            kept,
        )
    finally:
        if kept is None:
            shutil.rmtree(folder)


def torment(field: Field, planned: list[Planned], done: list[Done]) -> None:
    """Do what is planned, and note in `done` what was done."""
    begun = time.monotonic()
    under_way: list[tuple[float, float, Planned, AbstractContextManager[None]]] = []
    waiting = list(planned)
    while waiting or under_way:
        now = time.monotonic() - begun
        for one in [u for u in under_way if u[0] <= now]:
            under_way.remove(one)
            one[3].__exit__(None, None, None)
            done.append(Done(str(one[2]), one[1], time.monotonic(), one[2].costs))
        # On a busy machine a fault may begin late, while the next one on the same thing is due.
        if waiting and waiting[0].at_s <= now and all(waiting[0].to != one[2].to for one in under_way):
            fault = waiting.pop(0)
            doing = fault.kind.do(field, fault.to)
            began_s = time.monotonic()
            doing.__enter__()
            under_way.append((now + fault.lasts_s, began_s, fault, doing))
        time.sleep(0.01)
