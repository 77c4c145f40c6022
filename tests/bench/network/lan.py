"""A network of its own for every machine of a ward: kernel namespaces on two switches. Needs root and iproute2.

A line loses packets by a filter of four instructions, classic BPF, on what comes in at either end: not every kernel has netem.
"""

import os
import shutil
import subprocess
from collections.abc import Mapping
from types import TracebackType
from typing import Self

_SWITCH = "lan"
#: drop (2) a random number of packets in 2³², pass (0) the others
_LOSES = "4,32 0 0 4294963256,53 0 1 {of},6 0 0 0,6 0 0 2"
_TRUNK = ("trunk-a", "trunk-b")


def impossible() -> str:
    """Why there can be no such network here; empty where there can."""
    if os.geteuid() != 0:
        return "namespaces of the network need root"
    if missing := [name for name in ("ip", "tc") if shutil.which(name) is None]:
        return f"{' and '.join(missing)} not installed (Debian: apt-get install iproute2)"
    try:
        with Lan({"x": "a"}) as lan:
            lan.lose("x", 0.5)
    except subprocess.CalledProcessError as error:
        return f"the kernel, or who runs us, does not let us: {' '.join(error.cmd)}: {error.stderr.strip()}"
    return ""


class Lan:
    """machines: each with its switch, `a` or `b`; the switches are joined by a trunk. Each has an `address`."""

    def __init__(self, machines: Mapping[str, str]) -> None:
        self._mark = f"tr{os.getpid()}"
        self.machines = tuple(machines)
        self.address = {name: f"10.77.0.{number}" for number, name in enumerate(machines, 1)}
        self._spaces: list[str] = []
        try:
            self._lay(machines)
        except BaseException:
            self.close()
            raise

    def inside(self, machine: str) -> list[str]:
        """What runs a command on a machine."""
        return ["ip", "netns", "exec", self._space(machine)]

    def lose(self, machine: str, share: float) -> None:
        """Of all packets to and from a machine this share gets lost from now on; 1: a black hole, 0: none."""
        self._filter(self._space(machine), "eth0", share)
        self._filter(self._space(_SWITCH), machine, share)

    def part(self, *, parted: bool) -> None:
        """Whether the two switches hear nothing of each other."""
        for end in _TRUNK:
            self._filter(self._space(_SWITCH), end, float(parted))

    def close(self) -> None:
        """Take it all down."""
        for space in self._spaces:
            subprocess.run(["ip", "netns", "del", space], check=False, capture_output=True)
        self._spaces = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _lay(self, machines: Mapping[str, str]) -> None:
        for name in (_SWITCH, *machines):
            _run("ip", "netns", "add", self._space(name))
            self._spaces.append(self._space(name))
        switch = self._space(_SWITCH)
        for side in "ab":
            _run("ip", "-n", switch, "link", "add", f"switch-{side}", "type", "bridge")
            _run("ip", "-n", switch, "link", "set", f"switch-{side}", "up")
        _run("ip", "-n", switch, "link", "add", _TRUNK[0], "type", "veth", "peer", "name", _TRUNK[1])
        ports = {name: f"switch-{side}" for name, side in machines.items()}
        for name in machines:
            space = self._space(name)
            _run("ip", "link", "add", name, "netns", switch, "type", "veth", "peer", "name", "eth0", "netns", space)
            _run("ip", "-n", space, "addr", "add", f"{self.address[name]}/24", "dev", "eth0")
            for device in ("lo", "eth0"):
                _run("ip", "-n", space, "link", "set", device, "up")
            self._filtered(space, "eth0")
        for port, side in (ports | dict(zip(_TRUNK, ("switch-a", "switch-b"), strict=True))).items():
            _run("ip", "-n", switch, "link", "set", port, "master", side, "up")
            self._filtered(switch, port)

    def _space(self, name: str) -> str:
        return f"{self._mark}-{name}"

    @staticmethod
    def _filtered(space: str, device: str) -> None:
        _run("tc", "-n", space, "qdisc", "add", "dev", device, "clsact")

    @staticmethod
    def _filter(space: str, device: str, share: float) -> None:
        _run("tc", "-n", space, "filter", "del", "dev", device, "ingress")
        if share > 0:
            code = _LOSES.format(of=min(2**32 - 1, round(share * 2**32)))
            _run("tc", "-n", space, *f"filter add dev {device} ingress bpf da bytecode".split(), code)


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True)
