"""A Debian 12 in a folder, run with its own systemd by systemd-nspawn, without a network. Needs root."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

#: packages of a Debian 12 server, and the dependencies of the release: the machine has no network to install them later
PACKAGES = "systemd,systemd-sysv,udev,dbus,sudo,procps,ca-certificates,python3,python3-venv,libstdc++6,bluez,man-db"


def debootstrap(folder: Path, packages: str = PACKAGES) -> None:
    """Make the folder's Debian, with these packages, unless an earlier call made it."""
    if folder.exists():
        return
    making = folder.with_name(f"{folder.name}.new")
    subprocess.run(["rm", "-rf", str(making)], check=True)
    folder.parent.mkdir(exist_ok=True)
    words = ["debootstrap", "--variant=minbase", f"--include={packages}", "bookworm", str(making)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    making.rename(folder)


def wait(seconds: float, met: Callable[[], bool]) -> bool:
    """Wait until a condition is met; False if it is not met in time."""
    end = time.monotonic() + seconds
    while not (there := met()) and time.monotonic() < end:
        time.sleep(0.5)
    return there


class Machine:
    """Context of a running Debian guest; the exit ends all its processes."""

    def __init__(self, root: Path) -> None:
        words = ["systemd-nspawn", "--quiet", "--boot", f"--directory={root}", f"--machine=truerate-{os.getpid()}"]
        words += ["--private-network", "--register=no", "--keep-unit", "--console=pipe", "--link-journal=no"]
        words += ["--resolv-conf=off", "--timezone=off"]
        self.root = root
        self._container = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        children = Path(f"/proc/{self._container.pid}/task/{self._container.pid}/children")
        wait(30, lambda: bool(children.read_text().strip()))
        self._init = int(children.read_text().split()[-1])

    def __enter__(self) -> Self:
        states = {"running", "degraded"}
        if not wait(60, lambda: self.run("systemctl is-system-running").stdout.strip() in states):
            self.__exit__()
            raise TimeoutError(f"systemd in {self.root} has not started within 60 s")
        return self

    def __exit__(self, *_: object) -> None:
        os.kill(self._init, signal.SIGKILL)
        self._container.wait(60)

    def network(self, *words: str) -> None:
        """Run a program of the host in the guest's network."""
        subprocess.run(["nsenter", f"--target={self._init}", "-n", *words], check=True)

    def started(self, *words: str) -> "subprocess.Popen[str]":
        """Start a program of the host in the guest's network."""
        inside = ["nsenter", f"--target={self._init}", "-n", *words]
        return subprocess.Popen(inside, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def run(self, command: str, seconds: float = 900) -> subprocess.CompletedProcess[str]:
        """Run a shell command on the guest as root."""
        enter = [
            "nsenter",
            f"--target={self._init}",
            "-m",
            "-u",
            "-i",
            "-n",
            "-p",
            "-C",
            f"--wd=/proc/{self._init}/root",
        ]
        environ = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "DEBIAN_FRONTEND": "noninteractive"}
        return subprocess.run(
            [*enter, "sh", "-c", f"cd /root; {command}"],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=seconds,
            check=False,
            env=environ,
        )
