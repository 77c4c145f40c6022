"""Traffic that must change nothing, and a flood of it that must delay nobody. `make bench-hostile`.

First an hour of two devices, recorded, shuffled and played twice to a service whose devices are silent, then in its own order;
and wildcard, foreign and forged messages. Accepted has to be 0, each counted by its reason, the hash of each session unchanged.

Then through a router and an estimator, processes of their own: devices at 104 Hz in batches of 5, all enrolled. For half the run
nothing else; then one enrolled device sends --hz batches a second, and another sender as many under 100,000 invented names. p99
from put to a healthy subscriber, quiet and under the flood of the same run: goal twice; memory of estimator and router at each
end: goal no more than GROWN_MB beyond; and every sample of the innocent.
"""

import argparse
import contextlib
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bridge.bus.zenoh_bus import ZenohBus
from bridge.config.enrolment import Enrolment
from bridge.reasons.codes import Code
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire import columns_pb2 as columns
from bridge.wire.messages import Floats
from estimator.client import Client
from estimator.demo.ward import free_port, listens
from tests.bench.load.stream import BRIDGE, WARD, Fleet, name
from tests.bench.suffering import Healthy, process
from tests.estimator.served import Served
from tests.estimator.service import hostile
from tests.estimator.stream import calibration
from tests.sentences import codes

INVENTED = 100_000
#: p99 under the flood over p99 without; and what a process may grow by meanwhile, where names without end are kept it is more
SLOWER, GROWN_MB = 2.0, 64.0
#: what a flooder has to get ready in
READY_S = 8.0


def replayed(hours: float) -> bool:
    """An hour played twice."""
    logging.getLogger("estimator").setLevel(logging.ERROR)  # that it cannot keep up, where time is ours, is no news
    names = ("chest", "back")
    streams = {n: calibration(seed=i, after=[Still(3600 * hours)]) for i, n in enumerate(names)}
    with Served(Enrolment(enrolled=tuple(f"bridge/{n}" for n in names))) as served:
        recorded = hostile.lived(served, streams, boot=6)[0] + hostile.lived(served, streams, boot=7)[0]
        for _ in range(20):
            served.round(0.5)
        before = [hostile.state(served, n) for n in names]
        rng = np.random.default_rng(1)
        began = time.process_time()
        said = hostile.played(served, map(hostile.message, hostile.twice_shuffled(recorded, rng)))
        said += hostile.played(served, map(hostile.message, recorded))
        took = time.process_time() - began
        for batch in recorded[1000:2000:10]:
            other = names[batch.device == names[0]]
            lot = [*hostile.wildcards(batch), *hostile.foreign(batch, other), *hostile.forged(batch, rng)]
            said += hostile.played(served, lot)
        same = before == [hostile.state(served, n) for n in names]
        counts = served.service._count_all()
        print(
            f"{len(recorded)} messages of {hours:g} h played three times, {1e6 * took / 3 / len(recorded):.0f} µs each:"
        )
        print(f"  {said} samples accepted; state hash {'unchanged' if same else 'CHANGED'}")
        for device in names:
            sequence = served.service._devices[device].session.sequence
            print(f"  {device}: dropped {sequence.dropped.as_dict()}, events {sequence.events.as_dict()}")
        print(f"  ward: {counts}", flush=True)
    return same and said == 0


def flood(endpoint: str, which: str, hz: float, at: float) -> None:
    """From a moment of wall time until killed: in bursts each millisecond."""
    batch = replace(calibration(after=[]).part(0, 5).batches([])[0], device=name(0))
    payload = codec.encode_samples(batch)
    with ZenohBus([endpoint]) as bus:
        session = bus._session
        time.sleep(max(0.0, at - time.time()))
        due, n = time.monotonic(), 0
        while True:
            for _ in range(max(1, round(hz / 1000))):
                device = name(0) if which == "enrolled" else f"ghost-{n % INVENTED}"
                session.put(keys.build(WARD, "raw", bridge=BRIDGE, device=device), payload)
                n += 1
            due += 1e-3
            time.sleep(max(0.0, due - time.monotonic()))


def cpu_s(process: subprocess.Popen[bytes]) -> float:
    fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100


def rss_mb(process: subprocess.Popen[bytes]) -> float:
    fields = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8").split()
    return int(fields[fields.index("VmRSS:") + 1]) / 1024


def flooded(devices: int, seconds: float, hz: float, floods: Sequence[str]) -> list[str]:
    """What was not reached."""
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        folder, endpoint = Path(place), f"tcp/127.0.0.1:{free_port()}"
        config = folder / "ward.toml"
        enrolled = ", ".join(f'"{BRIDGE}/{name(i)}"' for i in range(devices))
        config.write_text(
            f'ward = "{WARD}"\n[bus]\nconnect = ["{endpoint}"]\n[router]\nlisten = ["{endpoint}"]\n'
            f'[devices]\nenrolled = [{enrolled}]\n[estimator]\nid = "e"\nstore = "{folder}/store.sqlite3"\n'
        )
        words = ("estimator.cli.main", "router", "--config", str(config))
        router = stack.enter_context(process(*words, log=folder / "router.log"))
        if not listens(endpoint, 20.0):
            raise RuntimeError("the router does not listen")
        log = folder / "estimator.log"
        estimator = stack.enter_context(process("estimator.cli.main", "estimator", "serve", str(config), log=log))
        while "serves ward" not in log.read_text():
            time.sleep(0.1)
        healthy = Healthy(endpoint)
        stack.callback(healthy.close)
        fleet, bus = Fleet(devices, 104.0, 5), stack.enter_context(ZenohBus([endpoint]))
        publishers = [bus.publisher(key, cache=round(5.0 / fleet.period_s)) for key in fleet.keys]
        time.sleep(1.0)
        rounds = round(seconds / fleet.period_s)
        with contextlib.ExitStack() as attackers:
            at = time.time() + READY_S + seconds / 2
            senders = [
                attackers.enter_context(
                    process(
                        *(
                            "tests.bench.forged",
                            "--flood",
                            which,
                            "--endpoint",
                            endpoint,
                            "--hz",
                            str(hz),
                            "--at",
                            str(at),
                        ),
                        log=folder / "flood.log",
                    )
                )
                for which in floods
            ]
            time.sleep(max(0.0, at - seconds / 2 - time.time()))
            due, began_ns = time.monotonic(), round(at * 1e9)
            for number in range(rounds):
                if number == rounds // 2:
                    before, before_router = rss_mb(estimator), rss_mb(router)
                    spent = [cpu_s(one) for one in (estimator, router, *senders)]
                for i, payload in fleet.round(number, time.time_ns()):
                    publishers[i].put(payload)
                due += fleet.period_s
                time.sleep(max(0.0, due - time.monotonic()))
            after, after_router = rss_mb(estimator), rss_mb(router)
            cpu = [cpu_s(one) - before_s for one, before_s in zip((estimator, router, *senders), spent, strict=True)]
        time.sleep(2.0)
        with Client((endpoint,), ward=WARD) as client:
            statuses = client.statuses(wait_s=1.5)
        quiet, loud = latencies(healthy, began_ns, fleet, seconds)
        listed = sum(Code.NOT_ENROLLED in codes(status.reason) for status in statuses.values())
        print(
            f"{devices} devices for {seconds:g} s, {hz:g} batches a second of one and as many of {INVENTED} invented:"
        )
        for title, found in (("quiet", quiet), ("flooded", loud)):
            p50, p99 = 1e3 * np.percentile(found, (50, 99))
            print(
                f"  {title}: p50 {p50:.1f} ms, p99 {p99:.1f} ms, worst {1e3 * found.max():.1f} ms, {len(found)} batches"
            )
        print(
            f"  MB before and after: estimator {before:.0f}, {after:.0f}; router {before_router:.0f}, {after_router:.0f}"
        )
        print(f"  CPU under the flood: estimator, router, flooders: {', '.join(f'{s:.1f}' for s in cpu)} s")
        print(f"  {listed} strangers listed; {name(0)}: {statuses[name(0)].events}, {statuses[name(0)].dropped}")
        print(
            "\n".join(f"  {line}" for line in log.read_text().splitlines() if "so far" in line),
            flush=True,
        )
        lost = missing(healthy.heard, fleet, range(rounds // 2 * fleet.batch, rounds * fleet.batch))
        ratio = float(np.percentile(loud, 99) / np.percentile(quiet, 99))
        print(f"  p99 is {ratio:.2f} times that of the quiet half; {lost} samples of the innocent are missing")
        grown = {"estimator": after - before, "router": after_router - before_router}
        return [
            *([f"p99 {ratio:.2f} times that of the quiet half (goal {SLOWER:g})"] if ratio > SLOWER else []),
            *([f"{lost} samples of the innocent are missing (goal 0)"] if lost else []),
            *(f"the {who} grew by {mb:.0f} MB (goal {GROWN_MB:g})" for who, mb in grown.items() if mb > GROWN_MB),
        ]


def latencies(healthy: Healthy, began_ns: int, fleet: Fleet, seconds: float) -> tuple[Floats, Floats]:
    quiet, loud = list[float](), list[float]()
    innocent = {name(i) for i in range(1, fleet.n)}
    settled_ns = began_ns - round(0.25e9 * seconds)
    for now_ns, _, payload in healthy.heard:
        batch = columns.CorrectedBatch.FromString(payload)
        if batch.device in innocent and batch.start_time_ns > settled_ns:
            (loud if batch.start_time_ns >= began_ns else quiet).append((now_ns - batch.start_time_ns) * 1e-9)
    return np.array(quiet), np.array(loud)


def missing(heard: Sequence[tuple[int, str, bytes]], fleet: Fleet, expected: range) -> int:
    """How many of these samples of each of the innocent never came."""
    came: dict[str, set[int]] = {name(i): set() for i in range(1, fleet.n)}
    for _, _, payload in heard:
        batch = columns.CorrectedBatch.FromString(payload)
        if batch.device in came:
            came[batch.device].update(range(batch.sequence, batch.sequence + len(batch.ticks) // 8))
    return sum(len(set(expected) - numbers) for numbers in came.values())


def main() -> int:
    """1 when anything was accepted that must not be, or a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--devices", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--hz", type=float, default=5000.0)
    parser.add_argument("--floods", nargs="+", default=["enrolled", "invented"])
    parser.add_argument("--only", choices=("replayed", "flooded"))
    parser.add_argument("--flood", choices=("enrolled", "invented"), help=argparse.SUPPRESS)
    parser.add_argument("--at", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("--endpoint", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.flood:
        flood(given.endpoint, given.flood, given.hz, given.at)
    missed = []
    if given.only != "flooded" and not replayed(given.hours):
        missed.append("something was accepted, or changed a session (goal nothing)")
    if given.only != "replayed":
        missed += flooded(given.devices, given.seconds, given.hz, given.floods)
    if missed:
        print(f"not reached: {'; '.join(missed)}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
