"""The demonstration's ward: virtual devices behind pseudo-terminals; router, bridge and estimator as processes."""

import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from bridge.sim.pty_port import PtyPort
from bridge.sim.virtual_device import DeviceSpec, VirtualDevice, demo_device

WARD = "demo"
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
"""
_DEVICE = """
[[bridge.devices]]
id = "{id}"
driver = "native"
port = "{port}"
"""


class DemoFailed(Exception):
    """A part of the ward did not start or stopped: which one, and the end of what it said."""


class Ward:
    """Devices, ports and processes; all ended by close. Logs of the processes stay in `folder`."""

    def __init__(self, names: list[str], seed: int) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="truerate-demo-"))
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self.devices: dict[str, VirtualDevice] = {}
        self._ports: dict[str, PtyPort] = {}
        self.config = self.folder / "ward.toml"
        places = {name: self.folder / "ports" / name for name in names}
        self._seeds = {name: seed + number for number, name in enumerate(names)}
        devices = "".join(_DEVICE.format(id=name, port=place) for name, place in places.items())
        self.config.write_text(
            _CONFIG.format(ward=WARD, endpoint=self.endpoint, devices=devices, folder=self.folder), encoding="utf-8"
        )
        self._places = places

    def start_processes(self) -> None:
        """Router, estimator and bridge, in any order: each waits for what it needs."""
        self._start("router", "router", "--config", str(self.config))
        self._start("estimator", "estimator", "serve", str(self.config))
        self._start("bridge", "bridge", "run", str(self.config))

    def plug(self, name: str) -> None:
        """Switch a device on and plug it in."""
        # It waits for the bridge, so that its very first sample is counted too.
        spec = DeviceSpec(wait_for_host=True)
        self.devices[name] = demo_device(name, self._seeds[name], spec=spec)
        self._ports[name] = PtyPort(self.devices[name], self._places[name])

    def check(self) -> None:
        """Raise DemoFailed when a process has stopped."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                said = (self.folder / f"{name}.log").read_text(errors="replace")[-2000:]
                raise DemoFailed(f"the {name} stopped with exit code {process.returncode}:\n{said}")

    def close(self) -> None:
        """End the processes, last first, and unplug everything."""
        for process in reversed(list(self._processes.values())):
            process.terminate()
        for process in self._processes.values():
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        for port in self._ports.values():
            port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _start(self, name: str, *arguments: str) -> None:
        with (self.folder / f"{name}.log").open("wb") as log:
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-m", "estimator.cli", *arguments], stdout=log, stderr=log, stdin=subprocess.DEVNULL
            )


def free_port() -> int:
    """A TCP port on loopback that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def wait_for(endpoint: str, timeout_s: float) -> bool:
    """Whether something listens at a tcp endpoint within timeout_s."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        with socket.socket() as probe:
            if probe.connect_ex((host, int(port))) == 0:
                return True
        time.sleep(0.05)
    return False
