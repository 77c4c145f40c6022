"""The ward that is tormented: devices behind pseudo-terminals, each part with its own line to the router, and who listens."""

import resource
import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from bridge.bus import router_file, zenoh_settings
from bridge.bus.zenoh_bus import ZenohBus
from bridge.sim.imu_errors import DEMO_SPEC
from bridge.sim.motion_scripts import demo_script
from bridge.sim.sample_source import SimulatedSource, TrueSamples
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice
from bridge.wire import codec, keys
from estimator.client import Client, Stream
from estimator.client.decoder import Decoder
from estimator.database import inspect
from estimator.demo import DemoFailed
from estimator.demo.ward import WARD, Ward, free_port
from tests.nemesis.clock import Clock
from tests.nemesis.history import Boot, Heard, History, Sent
from tests.nemesis.line import Lines

#: devices live so many times faster than we do
SPEED = 5.0
BRIDGE, ESTIMATOR, ROUTER = "bridge", "estimator", "router"
#: the line by which routers know of each other
TRUNK = "the routers' line"
_TRUTH_S = 1200.0


def numbered(part: str, count: int) -> tuple[str, ...]:
    """The first has no number."""
    return (part, *(f"{part}-{number}" for number in range(2, count + 1)))


class Listener(threading.Thread):
    """A program on the ward's routers that subscribes to all there is; what it got, and what was sent, is the history."""

    def __init__(self, devices: Mapping[str, VirtualDevice], *endpoints: str) -> None:
        super().__init__(name="listener", daemon=True)
        self.history = History()
        self._devices = devices
        self._bus = ZenohBus(endpoints)
        self._client = Client(ward=WARD, bus=self._bus)
        self._said = Stream(
            self._bus.subscribe(keys.pattern(WARD, "corrected"), history=False),
            Decoder("corrected", codec.decode_corrected),
        )
        self._corrected = self._client.corrected(on_miss=self.history.misses.append)
        self._statuses, self._calibrations = self._client.follow(), self._client.follow_calibrations()
        self._over = threading.Event()
        self.start()

    def run(self) -> None:
        while not self._over.is_set():
            self._look_at_devices()
            self._corrected.wait(0.05)
            self.history.said += [Heard(time.monotonic(), batch) for batch in self._said.drain()]
            for batch in self._corrected.drain():
                self.history.heard[batch.device, batch.boot].append(Heard(time.monotonic(), batch))
            for calibration in self._calibrations.drain():
                self.history.calibrations[calibration.id] = calibration
            for status in self._statuses.drain():
                self.history.statuses[status.device], self.history.status_s = status, time.monotonic()
                self.history.events.update((status.device, event) for event in status.events)

    def _look_at_devices(self) -> None:
        for name, device in self._devices.items():
            for boot, samples in dict(device.sent).items():
                known = self.history.sent[name, boot]
                if not known or known[-1].samples < samples:
                    known.append(Sent(time.monotonic(), samples))

    def wait_for(self, estimators: int) -> None:
        """Until so many say what they have."""
        deadline = time.monotonic() + 60.0
        while len({owned.estimator for owned in self._client.owned()}) < estimators:
            if time.monotonic() > deadline:
                raise DemoFailed(f"not all of {estimators} estimators are heard")

    def has_all(self) -> bool:
        """Whether the last sample that each device sent was heard."""
        last = [(name, *list(device.sent.items())[-1]) for name, device in self._devices.items() if device.sent]
        heard = [(self.history.heard.get((name, boot), ())[-1:], samples) for name, boot, samples in last]
        return all(one and one[0].batch.sequence + len(one[0].batch) >= samples for one, samples in heard)

    def close(self) -> History:
        """Stop; what was heard."""
        self._over.set()
        self.join()
        self._look_at_devices()
        for stream in (self._said, self._corrected, self._statuses, self._calibrations):
            for why, count in stream.refused.items():
                self.history.refused[why] = self.history.refused.get(why, 0) + count
        self._client.close()
        self._bus.close()
        self.history.end_s = time.monotonic()
        return self.history


class Field:
    """A ward of so many devices that are calibrated at every boot, in a folder; closed by leaving it."""

    def __init__(
        self, folder: Path, devices: int, seed: int, clock: Clock | None, estimators: int = 1, routers: int = 1
    ) -> None:
        self.names = tuple(f"d{number}" for number in range(devices))
        self.ward = Ward(folder, self.names)
        self.clock = clock
        self.estimators, self.routers = numbered(ESTIMATOR, estimators), numbered(ROUTER, routers)
        self.endpoints = [self.ward.endpoint, *(f"tcp/127.0.0.1:{free_port()}" for _ in self.routers[1:])]
        ports = [int(endpoint.rpartition(":")[2]) for endpoint in self.endpoints]
        self.lines = {part: Lines(ports) for part in (BRIDGE, *self.estimators)}
        if len(ports) > 1:
            self.lines[TRUNK] = Lines(ports[:1])
        for router, endpoint in list(zip(self.routers, self.endpoints, strict=True))[1:]:
            self._another_router(router, endpoint)
        for part in self.estimators[1:]:
            self.ward.add(part, "estimator", "serve", str(self.ward.config))
        text = self.ward.config.read_text(encoding="utf-8")
        for number, part in enumerate((BRIDGE, *self.estimators)):
            theirs = folder / f"{part}.toml"
            # One after the other goes first to another router.
            there = [f'"tcp/127.0.0.1:{port}"' for port in self.lines[part].ports]
            there = there[number % len(there) :] + there[: number % len(there)]
            its = text.replace(f'connect = ["{self.ward.endpoint}"]', f"connect = [{', '.join(there)}]")
            if part in self.estimators[1:]:
                its = its.replace('"estimator-1"', f'"{part}"').replace("truerate.sqlite3", f"{part}.sqlite3")
            theirs.write_text(its, encoding="utf-8")
            self.ward.configure(part, theirs, {} if clock is None else clock.environment(part))
        spec = DeviceSpec(wait_for_host=True, truth_s=_TRUTH_S)
        self.devices = {
            name: VirtualDevice(name, SimulatedSource(demo_script, DEMO_SPEC, 104.0), seed * 100 + number, spec)
            for number, name in enumerate(self.names)
        }

    def begin(self) -> Listener:
        """Start everything."""
        self.ward.start(*self.routers, *self.estimators)
        self.ward.wait_for_router()
        listener = Listener(self.devices, *self.endpoints)
        listener.wait_for(len(self.estimators))  # a device that moves while it is turned is to be turned anew
        self.ward.start(BRIDGE)
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

    def fill_disk(self, part: str, *, full: bool) -> None:
        """Let no file of an estimator grow, or let them again."""
        most = 0 if full else resource.RLIM_INFINITY
        pid = self.ward.pid(part)
        # Before Python has told the kernel that it would rather hear of it, such a limit ends the process.
        if pid is not None and (not full or ignores(pid, signal.SIGXFSZ)):
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))

    # ---- what became of it ----------------------------------------------------------------------------------------

    def truth(self, boot: Boot, first: int, last: int) -> TrueSamples:
        """What is true of samples, both included; LookupError for such as were never sent."""
        name, number = boot
        return self.devices[name].truth.between(number, first, last)

    def complaints(self) -> list[str]:
        """What processes and store say of themselves, once all is over."""
        found = [
            f"the {part}'s log has a traceback: {log[log.index('Traceback') :][:400]!r}"
            for part in (*self.routers, BRIDGE, *self.estimators)
            if "Traceback" in (log := self.ward.log(part))
        ]
        stores = ["truerate", *self.estimators[1:]]
        for inspection in (inspect(self.ward.folder / f"{store}.sqlite3") for store in stores):
            found += [] if inspection.sound else [f"the store: {inspection}"]
        return found + self.ward.complaints

    def _another_router(self, name: str, endpoint: str) -> None:
        """It goes to the first, and does so again when it is back."""
        to = f"tcp/127.0.0.1:{self.lines[TRUNK].ports[0]}"
        file = self.ward.folder / f"{name}.json5"
        file.write_text(router_file.rendered(zenoh_settings.joined(router_file.plain([endpoint]), [to]), name), "utf-8")
        self.ward.add(name, "router", "--config", str(file))

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


def ignores(pid: int, number: signal.Signals) -> bool:
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    ignored = next(int(line.split()[1], 16) for line in lines if line.startswith("SigIgn"))
    return bool(ignored >> (number - 1) & 1)
