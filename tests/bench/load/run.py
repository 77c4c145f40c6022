"""One run: a router, a sender, the estimator or a bare relay, each a process; and what it took."""

import json
import subprocess
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.demo.ward import free_port
from tests.bench.load.receiver import Receiver
from tests.bench.load.stream import WARD, listed
from tests.bench.programs import cpu_s, estimator, line, program, router, rss_mb, ward_file

#: a publisher that has ended its burst says every two seconds how far it came: what was lost of the end is fetched then
_QUIET_S = 5.0


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
    """What a run took of the process in the middle. cpu: shares of one core; lost in samples."""

    messages_per_s: float
    lost: int
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


def run(load: Load, *, relay: bool = False, wait_s: float = 120.0) -> Took:
    """Run it with the estimator or a bare relay, and wait for all to arrive or for nothing to come any more."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        file = ward_file(Path(folder), WARD, endpoint, listed(load.devices))
        through = stack.enter_context(router(file, endpoint))
        middle = program("tests.bench.load.relay", endpoint) if relay else estimator(file)
        worker = stack.enter_context(middle)
        time.sleep(1.0)
        receiver = Receiver(endpoint, relayed=relay)
        stack.callback(receiver.close)
        words = [endpoint, str(load.devices), str(load.rate_hz), str(load.batch), *load.mode]
        sender = stack.enter_context(program("tests.bench.load.sender", *words, pipe=True))
        return _measured(load, worker, through, receiver, sender, wait_s, exact=relay)


def _measured(
    load: Load,
    worker: subprocess.Popen[str],
    through: subprocess.Popen[str],
    receiver: Receiver,
    sender: subprocess.Popen[str],
    wait_s: float,
    *,
    exact: bool,
) -> Took:
    before = json.loads(line(sender))["before"]
    if load.burst:
        _first(receiver, wait_s)
    began_s, cpu, router_cpu, warm_rss = time.monotonic(), cpu_s(worker.pid), cpu_s(through.pid), rss_mb(worker.pid)
    arrived = len(receiver.heard)
    said = json.loads(line(sender))
    spent_s = max(_last(receiver, said["sent"], wait_s, exact=exact) - began_s, 1e-9)
    cpu, router_cpu, rss = cpu_s(worker.pid) - cpu, cpu_s(through.pid) - router_cpu, rss_mb(worker.pid)
    latency = receiver.latency_s()[arrived:]
    return Took(
        messages_per_s=(said["sent"] - before) / spent_s,
        lost=said["sent"] * load.batch - receiver.samples().total(),
        cpu=cpu / spent_s,
        router_cpu=router_cpu / spent_s,
        warm_rss_mb=warm_rss,
        rss_mb=rss,
        p50_s=float(np.percentile(latency, 50)),
        p99_s=float(np.percentile(latency, 99)),
        sender_late_s=said["late_s"],
        whole=0 if load.burst else receiver.whole(load.rate_hz),
    )


def _first(receiver: Receiver, wait_s: float) -> None:
    deadline = time.monotonic() + wait_s
    while not receiver.heard:
        if time.monotonic() > deadline:
            raise RuntimeError("nothing came")
        time.sleep(0.001)


def _last(receiver: Receiver, sent: int, wait_s: float, *, exact: bool) -> float:
    """When the last message came; without a count to wait for, when nothing came for so long that nothing will."""
    last, count, deadline = time.monotonic(), len(receiver.heard), time.monotonic() + wait_s
    while time.monotonic() < deadline:
        time.sleep(0.01)
        if len(receiver.heard) != count:
            last, count = time.monotonic(), len(receiver.heard)
        elif time.monotonic() - last > (0.0 if exact and count >= sent else _QUIET_S):
            break
    return last
