"""The ward that is tormented: devices behind pseudo-terminals, each part with its own line to the router, and who listens."""

import resource
import signal
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from bridge.sim.imperfection import DEMO_SPEC
from bridge.sim.script import demo_script
from bridge.sim.source import SimulatedSource
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice
from estimator.client import Client
from estimator.database import inspect
from estimator.demo.ward import WARD, Ward
from tests.nemesis.clock import Clock
from tests.nemesis.history import Boot, Heard, History
from tests.nemesis.invariants import Floats
from tests.nemesis.line import Line

#: devices live so many times faster than we do
SPEED = 5.0
PARTS = ("bridge", "estimator")
_TRUTH_S = 1200.0


class Listener(threading.Thread):
    """A program on the ward's router that subscribes to all there is; what it got is the history."""

    def __init__(self, endpoint: str) -> None:
        super().__init__(name="listener", daemon=True)
        self.history = History()
        self._client = Client((endpoint,), ward=WARD)
        self._corrected = self._client.corrected(on_miss=self.history.misses.append)
        self._statuses, self._calibrations = self._client.follow(), self._client.follow_calibrations()
        self._over = threading.Event()
        self.start()

    def run(self) -> None:
        while not self._over.is_set():
            batch = self._corrected.receive(0.05)
            if batch is not None:
                self.history.heard[batch.device, batch.boot].append(Heard(time.monotonic(), batch))
            for calibration in self._calibrations.drain():
                self.history.calibrations[calibration.id] = calibration
            for status in self._statuses.drain():
                self.history.statuses[status.device], self.history.status_s = status, time.monotonic()
                self.history.events.update((status.device, event) for event in status.events)

    def close(self) -> History:
        """Stop; what was heard."""
        self._over.set()
        self.join()
        self._client.close()
        self.history.end_s = time.monotonic()
        return self.history


class Field:
    """A ward of so many devices that are calibrated at every boot, in a folder; closed by leaving it."""

    def __init__(self, folder: Path, devices: int, seed: int, clock: Clock | None) -> None:
        self.names = tuple(f"d{number}" for number in range(devices))
        self.ward = Ward(folder, self.names)
        self.clock = clock
        router = int(self.ward.endpoint.rpartition(":")[2])
        self.lines = {part: Line(router) for part in PARTS}
        text = self.ward.config.read_text(encoding="utf-8")
        for part, line in self.lines.items():
            theirs = folder / f"{part}.toml"
            there = f'connect = ["tcp/127.0.0.1:{line.port}"]'
            theirs.write_text(text.replace(f'connect = ["{self.ward.endpoint}"]', there), encoding="utf-8")
            self.ward.configure(part, theirs, {} if clock is None else clock.environment(part))
        spec = DeviceSpec(wait_for_host=True, truth_s=_TRUTH_S)
        self.devices = {
            name: VirtualDevice(name, SimulatedSource(demo_script, DEMO_SPEC, 104.0), seed * 100 + number, spec)
            for number, name in enumerate(self.names)
        }

    def begin(self) -> Listener:
        """Start everything."""
        self.ward.start("router", "estimator", "bridge")
        self.ward.wait_for_router()
        listener = Listener(self.ward.endpoint)
        for name, device in self.devices.items():
            self.ward.plug(name, device, speed=SPEED, lossless=True)
        return listener

    # ---- what may be done to it ----------------------------------------------------------------------------------

    def kill(self, part: str) -> None:
        """End it at once, and say nothing."""
        self.ward.stop(part, signal.SIGKILL)

    def send(self, part: str, number: signal.Signals) -> None:
        """A signal."""
        self.ward.send(part, number)

    def fill_disk(self, *, full: bool) -> None:
        """Let no file of the estimator grow, or let them again."""
        most = 0 if full else resource.RLIM_INFINITY
        pid = self.ward.pid("estimator")
        # Before Python has told the kernel that it would rather hear of it, such a limit ends the process.
        if pid is not None and (not full or _ignores(pid, signal.SIGXFSZ)):
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))

    # ---- what became of it ----------------------------------------------------------------------------------------

    def truth(self, boot: Boot, sequence: int) -> Floats:
        """The true bias (3,) of a sample, rad/s."""
        name, number = boot
        return np.asarray(self.devices[name].truth_between(number, sequence, sequence).bias[0])

    def complaints(self) -> list[str]:
        """What processes and store say of themselves, once all is over."""
        found = [
            f"the {part}'s log has a traceback: {log[log.index('Traceback') :][:400]!r}"
            for part in ("router", *PARTS)
            if "Traceback" in (log := self.ward.log(part))
        ]
        inspection = inspect(self.ward.folder / "truerate.sqlite3")
        return found if inspection.sound else [*found, f"the store: {inspection}"]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for line in self.lines.values():
            line.mend()
        self.ward.close()
        for line in self.lines.values():
            line.close()


def _ignores(pid: int, number: signal.Signals) -> bool:
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    ignored = next(int(line.split()[1], 16) for line in lines if line.startswith("SigIgn"))
    return bool(ignored >> (number - 1) & 1)
