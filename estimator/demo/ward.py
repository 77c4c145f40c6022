"""Ward on this machine: virtual devices on pseudo-terminals; router, bridge, estimator and dashboard as processes."""

import contextlib
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import VirtualDevice
from estimator.calibration.method_names import DEFAULT
from estimator.demo import DemoFailed

WARD = "demo"
#: below the port range used for outgoing connections
_LISTENING = range(20_000, 30_000)
#: sockets that hold the ports which were given
_places = list[socket.socket]()
#: s to wait for a process to end
_PATIENCE_S = 30.0
_CONFIG = """ward = "{ward}"

[bus]
connect = ["{endpoint}"]

[router]
listen = ["{endpoint}"]

[bridge]
id = "bridge-1"
{devices}
[estimator]
id = "estimator-1"
store = "{folder}/truerate.sqlite3"
method = "{method}"

[dashboard]
listen = "{page}"
"""
_DEVICE = """
[[bridge.devices]]
id = "{id}"
driver = "native"
port = "{port}"
"""


class Ward:
    """Ward on this machine: virtual devices on pseudo-terminals, and its programs as processes; `close` ends all.

    folder: for configuration and logs. names: ids of the devices. method: calibration method.
    """

    def __init__(self, folder: Path, names: tuple[str, ...], method: str = DEFAULT) -> None:
        self.folder = folder
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.page = f"127.0.0.1:{free_port()}"
        self.config = folder / "ward.toml"
        self.ports: dict[str, PtyPort] = {}
        #: faults in how processes ended
        self.complaints: list[str] = []
        self._places = {name: folder / "ports" / name for name in names}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._logs: dict[str, threading.Thread] = {}
        devices = "".join(_DEVICE.format(id=name, port=place) for name, place in self._places.items())
        self.config.write_text(
            _CONFIG.format(
                ward=WARD, endpoint=self.endpoint, devices=devices, folder=folder, method=method, page=self.page
            ),
            encoding="utf-8",
        )
        self._arguments: dict[str, tuple[str, ...]] = {
            "router": ("router", "--config", str(self.config)),
            "estimator": ("estimator", "serve", str(self.config)),
            "bridge": ("bridge", "run", str(self.config)),
            "dashboard": ("dashboard", "--config", str(self.config)),
        }
        self._environment: dict[str, dict[str, str]] = {}

    def add(self, name: str, *arguments: str) -> None:
        """Add a process that runs `truerate` with the given arguments; `start` starts it. name: name of the process."""
        self._arguments[name] = arguments

    def configure(self, name: str, config: Path, environment: dict[str, str]) -> None:
        """Set another configuration file and environment variables for a process, before its start."""
        self._arguments[name] = tuple(
            str(config) if part == str(self.config) else part for part in self._arguments[name]
        )
        self._environment[name] = environment

    def start(self, *names: str) -> None:
        """Start processes by name: `router`, `estimator`, `bridge`, `dashboard`, or a process of `add`.

        The order is free, because each process waits for the others.
        """
        for name in names:
            process = self._processes[name] = subprocess.Popen(
                [sys.executable, "-m", "estimator.cli.main", *self._arguments[name]],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                bufsize=0,
                env={**os.environ, **self._environment.get(name, {})},
            )
            (self.folder / f"{name}.log").touch()
            # This process writes the log: the disk of the other may be full.
            self._logs[name] = threading.Thread(target=self._keep, args=(name, process.stdout), daemon=True)
            self._logs[name].start()

    def wait_for_router(self, timeout_s: float = 60.0) -> None:
        """Wait until the router listens. Raises DemoFailed after timeout_s, or as soon as a process has stopped."""
        deadline = time.monotonic() + timeout_s
        while not listens(self.endpoint, 1.0):
            self.check()
            if time.monotonic() > deadline:
                raise DemoFailed(f"the router does not listen on {self.endpoint} after {timeout_s:.0f} s")

    def stop(self, name: str, number: signal.Signals = signal.SIGTERM) -> None:
        """Stop one process with a signal; kill it if it does not end. Faults are added to `complaints`.

        number: the signal.
        """
        process = self._processes.pop(name)
        if process.poll() is not None:
            self.complaints.append(f"the {name} stopped unexpectedly with exit code {process.returncode}")
        process.send_signal(number)
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.complaints.append(f"the {name} did not end within {_PATIENCE_S:.0f} s")
            process.kill()
            process.wait()
        if number is signal.SIGTERM and process.returncode > 0:
            self.complaints.append(f"the {name} ended with exit code {process.returncode}")

    def pid(self, name: str) -> int | None:
        """Return the process id of a program of the ward, or None if it was not started or was stopped."""
        process = self._processes.get(name)
        return None if process is None else process.pid

    def send(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a running process of the ward, by the process's name."""
        self._processes[name].send_signal(number)

    def plug(self, name: str, device: VirtualDevice, *, speed: float = 1.0, lossless: bool = False) -> PtyPort:
        """Connect a virtual device to the port of this name, and return the port.

        speed: simulated seconds per real second. lossless: True stops the device's time while the
        reader has no room or the port is unplugged, so that no byte is lost.
        """
        self.ports[name] = PtyPort(device, self._places[name], speed=speed, lossless=lossless)
        return self.ports[name]

    def check(self) -> None:
        """Check that all started processes run. Raises DemoFailed if one has stopped by itself."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                raise DemoFailed(f"the {name} stopped with exit code {process.returncode}:\n{self.log(name)[-2000:]}")

    def log(self, name: str) -> str:
        """Return the text that a process has logged so far."""
        process = self._processes.get(name)
        if name in self._logs and (process is None or process.poll() is not None):
            self._logs[name].join(1.0)  # until its last output is written
        return (self.folder / f"{name}.log").read_text(encoding="utf-8", errors="replace")

    def close(self) -> None:
        """Stop the processes, the last started first, and unplug all devices."""
        for name in reversed(list(self._processes)):
            self.stop(name)
        for port in self.ports.values():
            port.close()

    def _keep(self, name: str, said: IO[bytes]) -> None:
        with said, (self.folder / f"{name}.log").open("ab", buffering=0) as log:
            shutil.copyfileobj(said, log)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def free_port() -> int:
    """Return a free TCP port on loopback, outside the range for outgoing connections.

    Inside that range, a connection could take the port while the process that listens there is restarted. While this
    process runs, this function gives the port to no other process.
    """
    while True:
        port, place = secrets.choice(_LISTENING), socket.socket()  # not `random`: tests seed that alike
        with contextlib.suppress(OSError):
            place.bind(("127.0.0.1", port))
            place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a server may listen beside it
            _places.append(place)
            return port
        place.close()


def listens(endpoint: str, timeout_s: float) -> bool:
    """Return True if a process listens at a TCP endpoint, such as `tcp/127.0.0.1:7447`, within timeout_s seconds."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        with socket.socket() as probe:
            if probe.connect_ex((host, int(port))) == 0:
                return True
        time.sleep(0.05)
    return False
