"""A ward over TLS on machines of its own: two routers, a bridge and an estimator on either side, subscribers; all processes."""

import json
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bridge.bus import router_file
from bridge.pki.certificate_checks import Identity
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member
from estimator.service.membership import owner
from tests.bench.network.lan import Lan

WARD, PORT = "w", 7447
#: machine -> its switch
MACHINES = {"r1": "a", "b1": "a", "e1": "a", "v1": "a", "r2": "b", "b2": "b", "e2": "b", "v2": "b"}
ROUTERS, BRIDGES, ESTIMATORS, VIEWERS = ("r1", "r2"), ("b1", "b2"), ("e1", "e2"), ("v1", "v2")
_ROLES = {"r": "router", "b": "bridge", "e": "estimator", "v": "viewer"}
_VERBS = {"bridge": ("bridge", "run"), "estimator": ("estimator", "serve")}
_BUS = """ward = "{ward}"
[bus]
connect = [{connect}]
ca = "{ca}"
certificate = "{certificate}"
key = "{key}"
"""
_DEVICE = '[[bridge.devices]]\nid = "{id}"\ndriver = "simulated"\nseed = {seed}\nspeed = {speed}\n'


@dataclass(slots=True)
class Heard:
    """What a subscriber was given, in its order, and what it heard estimators say to have."""

    batches: list[dict[str, Any]] = field(default_factory=list)
    misses: list[dict[str, Any]] = field(default_factory=list)
    owned: list[dict[str, Any]] = field(default_factory=list)
    ready: threading.Event = field(default_factory=threading.Event)

    def take(self, line: str) -> None:
        """One line of a listener."""
        said = json.loads(line)
        match said.pop("what"):
            case "batch":
                self.batches.append(said)
            case "miss":
                self.misses.append(said)
            case "owned":
                self.owned.append(said)
            case "ready":
                self.ready.set()

    def by_boot(self, since_s: float = 0.0) -> dict[tuple[str, int], list[dict[str, Any]]]:
        """Batches by device and boot, those that came after a time."""
        found: dict[tuple[str, int], list[dict[str, Any]]] = defaultdict(list)
        for batch in self.batches:
            if batch["at"] >= since_s:
                found[batch["device"], batch["boot"]].append(batch)
        return found


class Guarded:
    """All of it; each bridge has so many devices, which live so many times as fast as life."""

    def __init__(self, folder: Path, lan: Lan, stack: ExitStack, devices: int, speed: float) -> None:
        self._speed = speed
        self.lan, self._folder, self._stack = lan, folder, stack
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self.devices = {b: [f"{b}-d{number}" for number in range(devices)] for b in BRIDGES}
        self.heard = {name: Heard() for name in VIEWERS}
        self._write()

    def begin(self) -> None:
        """Start everything, and wait until all devices are calibrated at all subscribers."""
        for name in ROUTERS:
            self.start(name)
        self.until(lambda: all("listening" in self.log(name) for name in ROUTERS), 30.0)
        for name in (*VIEWERS, *ESTIMATORS):
            self.start(name)
        # A device that moves while it is turned is to be turned anew, and these are not.
        for heard in self.heard.values():
            self.until(lambda h=heard: {said["estimator"] for said in list(h.owned)} == set(ESTIMATORS), 30.0)  # type: ignore[misc]
        for name in BRIDGES:
            self.start(name)
        every = {device for devices in self.devices.values() for device in devices}
        for heard in self.heard.values():
            self.until(lambda h=heard: {b["device"] for b in list(h.batches) if b["good"]} == every, 120.0)  # type: ignore[misc]
        self.until(self.apart, 30.0)

    def start(self, name: str) -> None:
        """A machine's process."""
        role, file = _ROLES[name[0]], str(self._file(name))
        program = [sys.executable, "-m", "estimator.cli.main"]
        if role == "router":
            program += ["router", "--config", file]
        elif role == "viewer":
            program = [sys.executable, "-m", "tests.bench.network.listener", file]
        else:
            program += [*_VERBS[role], file]
        log = self._stack.enter_context((self._folder / f"{name}.log").open("a"))
        process = subprocess.Popen(
            [*self.lan.inside(name), *program],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if role == "viewer" else log,
            stderr=log,
            text=True,
        )
        self._processes[name] = process
        if role == "viewer":
            listening = threading.Thread(target=self._listen, args=(process, self.heard[name]), daemon=True)
            listening.start()
            self._stack.callback(listening.join)
        self._stack.callback(self.kill, name)

    def kill(self, name: str) -> None:
        """SIGKILL."""
        process = self._processes.pop(name, None)
        if process is not None:
            process.kill()
            process.wait()

    def stop(self, name: str) -> None:
        """SIGTERM."""
        process = self._processes.pop(name)
        process.terminate()
        process.wait(10)

    def send(self, name: str, number: signal.Signals) -> None:
        """A signal."""
        self._processes[name].send_signal(number)

    def until(self, true: Callable[[], bool], timeout_s: float) -> float:
        """How long it took, s."""
        began = time.monotonic()
        while not true():
            for name, process in self._processes.items():
                if process.poll() is not None:
                    raise RuntimeError(f"{name} ended: {(self._folder / f'{name}.log').read_text()[-2000:]}")
            if time.monotonic() - began > timeout_s:
                raise RuntimeError(f"it did not come in {timeout_s:.0f} s; {self._folder}")
            time.sleep(0.02)
        return time.monotonic() - began

    def apart(self) -> bool:
        """Whether all devices have an owner, and one, as every subscriber heard it last."""
        count = sum(map(len, self.devices.values()))
        for heard in self.heard.values():
            last = {said["estimator"]: set(said["held"]) for said in heard.owned[-20:]}
            if (
                len(last) < len(ESTIMATORS)
                or sum(map(len, last.values())) != count
                or len(set().union(*last.values())) != count
            ):
                return False
        return True

    def current(self) -> bool:
        """Whether every subscriber has every device's samples as they are made, and every device one owner."""
        return self.apart() and all(
            len(young) == sum(map(len, self.devices.values()))
            for heard in self.heard.values()
            for young in [
                {b["device"] for b in heard.batches[-400:] if b["age"] < 1.0 and b["at"] > time.monotonic() - 1.0}
            ]
        )

    def home(self) -> bool:
        """Whether every device is with the estimator that is to have it when all are alive."""
        last = {said["estimator"]: set(said["held"]) for said in self.heard[VIEWERS[0]].owned[-20:]}
        every = [device for devices in self.devices.values() for device in devices]
        return all(last.get(name) == {d for d in every if owner(d, ESTIMATORS) == name} for name in ESTIMATORS)

    def moves(self, viewer: str, since_s: float) -> int:
        """How often a device went from one estimator to another, as a subscriber heard it."""
        has: dict[str, tuple[int, str]] = {}
        count = 0
        for said in list(self.heard[viewer].owned):
            for device, epoch in said["held"].items():
                before, who = has.get(device, (0, ""))
                if epoch > before:
                    count += said["at"] >= since_s and who not in ("", said["estimator"])
                    has[device] = epoch, said["estimator"]
        return count

    def log(self, name: str) -> str:
        """What a process said."""
        return (self._folder / f"{name}.log").read_text()

    def _listen(self, process: "subprocess.Popen[str]", heard: Heard) -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                heard.take(line)

    def _file(self, name: str) -> Path:
        return self._folder / f"{name}.{'json5' if name in ROUTERS else 'toml'}"

    def _write(self) -> None:
        pki, now = Folder(self._folder / "pki"), utc_now()
        pki.make("two halves", now)
        members = {name: Member.parse(f"{_ROLES[name[0]]}:{name}") for name in self.lan.machines}
        files = {
            name: pki.issue(member, now, hosts=(self.lan.address[name],) if name in ROUTERS else ())
            for name, member in members.items()
        }
        places = {router: [(WARD, member) for name, member in members.items() if name != router] for router in ROUTERS}
        for router in ROUTERS:
            pki.admit(members[router], [member for _, member in places[router]])
            # One of two goes to the other, and does so again when it is back.
            join = [self._endpoint("r1")] if router == "r2" else []
            settings = router_file.guarded([self._endpoint(router)], pki.gate(members[router]), places[router], join)
            self._file(router).write_text(router_file.rendered(settings, router), "utf-8")
        for name in (*BRIDGES, *ESTIMATORS, *VIEWERS):
            self._file(name).write_text(self._config(name, files[name]), "utf-8")

    def _endpoint(self, router: str) -> str:
        return f"tls/{self.lan.address[router]}:{PORT}"

    def _config(self, name: str, files: Identity) -> str:
        # First to the router on its own side.
        routers = ROUTERS if MACHINES[name] == "a" else ROUTERS[::-1]
        connect = ", ".join(f'"{self._endpoint(router)}"' for router in routers)
        text = _BUS.format(ward=WARD, connect=connect, ca=files.ca, certificate=files.certificate, key=files.key)
        if name in BRIDGES:
            text += f'[bridge]\nid = "{name}"\n'
            for number, device in enumerate(self.devices[name]):
                seed = 100 * BRIDGES.index(name) + number
                text += _DEVICE.format(id=device, seed=seed, speed=self._speed)
        elif name in ESTIMATORS:
            text += f'[estimator]\nid = "{name}"\nstore = "{self._folder}/{name}.sqlite3"\n'
        return text


@contextmanager
def guarded(folder: Path, devices: int, speed: float = 2.0) -> Iterator[Guarded]:
    """A ward that runs, every device calibrated; they live so many times as fast as life."""
    with Lan(MACHINES) as lan, ExitStack() as stack:
        ward = Guarded(folder, lan, stack, devices, speed)
        ward.begin()
        yield ward
