"""One run: a router, a sender, the estimator or a relay, each a process; and what it took."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from estimator.demo.ward import free_port, listens
from tests.bench.load.receiver import Receiver
from tests.bench.load.stream import WARD, listed

_CONFIG = """ward = "{ward}"
[bus]
connect = ["{endpoint}"]
[estimator]
id = "e"
store = "{folder}/store.sqlite3"
"""
_TICK = os.sysconf("SC_CLK_TCK")
#: a publisher that has ended its burst says every two seconds how far it came: what was lost of the end is fetched then
_QUIET_S = 5.0


class Middle(StrEnum):
    """What is between the senders and the subscriber."""

    RELAY = "relay"
    #: reads, corrects and writes each message, and nothing else
    RECODE = "recoding relay"
    ESTIMATOR = "estimator"


@dataclass(frozen=True, slots=True)
class Load:
    """devices x rate_hz in messages of `batch` samples, for `seconds`; or a burst of so many messages."""

    devices: int
    rate_hz: float = 104.0
    batch: int = 10
    seconds: float = 10.0
    burst: int = 0
    #: a ward that has just begun is not what is measured: publishers are made, and every device is warming up
    warm_s: float = 15.0

    @property
    def mode(self) -> tuple[str, str, str]:
        return ("burst", str(self.burst), "0") if self.burst else ("paced", str(self.seconds), str(self.warm_s))


@dataclass(frozen=True, slots=True)
class Took:
    """What a run took of the process in the middle. latency in s; cpu: shares of one core; lost and twice in samples."""

    sent: int
    seconds: float
    lost: int
    twice: int
    cpu: float
    router_cpu: float
    #: once it was warm, and at the end
    warm_rss_mb: float
    rss_mb: float
    p50_s: float
    p99_s: float
    sender_late_s: float
    #: devices that lost nothing in the last 20 s
    whole: int

    @property
    def messages_per_s(self) -> float:
        return self.sent / self.seconds


def run(load: Load, middle: Middle, wait_s: float = 120.0) -> Took:
    """Run it, and wait for all to arrive or for nothing to come any more."""
    with tempfile.TemporaryDirectory() as folder:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        config = Path(folder) / "ward.toml"
        config.write_text(
            _CONFIG.format(ward=WARD, endpoint=endpoint, folder=folder) + listed(load.devices), encoding="utf-8"
        )
        command = {
            Middle.RELAY: ["tests.bench.load.relay", endpoint],
            Middle.RECODE: ["tests.bench.load.relay", endpoint, "recode"],
            Middle.ESTIMATOR: ["estimator.cli.main", "estimator", "serve", str(config)],
        }[middle]
        with _process("estimator.cli.main", "router", "--listen", endpoint) as router:
            if not listens(endpoint, 20.0):
                raise RuntimeError("the router does not listen")
            with _process(*command) as worker:
                time.sleep(2.5)
                return _measured(load, endpoint, worker, router, middle, wait_s)


def _measured(
    load: Load,
    endpoint: str,
    worker: subprocess.Popen[bytes],
    router: subprocess.Popen[bytes],
    middle: Middle,
    wait_s: float,
) -> Took:
    receiver = Receiver(endpoint, relayed=middle is Middle.RELAY)
    arguments = [endpoint, str(load.devices), str(load.rate_hz), str(load.batch), *load.mode]
    with _process("tests.bench.load.sender", *arguments, pipe=True) as sender:
        before = json.loads(_line(sender))["before"]
        if load.burst:
            _first(receiver, wait_s)
        began_s, cpu, router_cpu, warm_rss = time.monotonic(), _cpu(worker), _cpu(router), _rss_mb(worker)
        arrived = receiver.count
        said = json.loads(_line(sender))
        ended_s = _last(receiver, said["sent"], wait_s, exact=middle is not Middle.ESTIMATOR)
        cpu, router_cpu = _cpu(worker) - cpu, _cpu(router) - router_cpu
        rss = _rss_mb(worker)
    _, samples, twice, latency = receiver.result()
    latency = latency[arrived:]
    whole = 0 if load.burst else receiver.whole(load.rate_hz)
    receiver.close()
    spent_s = max(ended_s - began_s, 1e-9)
    return Took(
        sent=said["sent"] - before,
        seconds=spent_s,
        lost=said["sent"] * load.batch - samples,
        twice=twice,
        cpu=cpu / spent_s,
        router_cpu=router_cpu / spent_s,
        warm_rss_mb=warm_rss,
        rss_mb=rss,
        p50_s=float(np.percentile(latency, 50)),
        p99_s=float(np.percentile(latency, 99)),
        sender_late_s=said["late_s"],
        whole=whole,
    )


def _first(receiver: Receiver, wait_s: float) -> None:
    deadline = time.monotonic() + wait_s
    while not receiver.count:
        if time.monotonic() > deadline:
            raise RuntimeError("nothing came")
        time.sleep(0.001)


def _last(receiver: Receiver, sent: int, wait_s: float, *, exact: bool) -> float:
    """When the last message came; without a count to wait for, when nothing came for so long that nothing will."""
    last, count, deadline = time.monotonic(), receiver.count, time.monotonic() + wait_s
    while time.monotonic() < deadline:
        time.sleep(0.01)
        if receiver.count != count:
            last, count = time.monotonic(), receiver.count
        elif time.monotonic() - last > (0.0 if exact and count >= sent else _QUIET_S):
            break
    return last


def _line(process: subprocess.Popen[bytes]) -> bytes:
    assert process.stdout is not None
    return process.stdout.readline()


@contextmanager
def _process(module: str, *arguments: str, pipe: bool = False) -> Iterator[subprocess.Popen[bytes]]:
    ends = subprocess.PIPE if pipe else subprocess.DEVNULL
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stdin=ends, stdout=ends, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        if pipe:
            process.communicate(b"\n")
        else:
            process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _cpu(process: subprocess.Popen[bytes]) -> float:
    fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICK


def _rss_mb(process: subprocess.Popen[bytes]) -> float:
    lines = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))
