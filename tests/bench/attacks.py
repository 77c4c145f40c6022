"""Attacks from one machine on a ward of real processes, and what those notice who did nothing. `make bench-hostile`.

Router, estimator and dashboard are processes; twelve devices send 104 samples a second each in batches of 5, and there is no
`[devices]` list. A visitor asks each second for the ward's page, logs in, and looks at a picture; a probe asks `/readyz`. Each
attack lasts seconds; the ward is watched for --after seconds more (600 is what the goals are about). Goals: a page within
1 s, a login within 2 s, a picture within 3 s; no hole of a device's corrected samples beyond 0.3 s; the estimator's memory
back within 10 % after two minutes; `/readyz` true throughout; SIGINT obeyed within 5 s.
"""

import argparse
import contextlib
import http.client
import multiprocessing
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

from starlette.routing import Route

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from estimator.demo.ward import free_port, listens
from estimator.web.app import routes as application_routes
from estimator.web.passwords import hashed
from tests.bench.load.stream import WARD, Fleet, name
from tests.bench.suffering import Healthy, process
from tests.estimator.stream import calibration
from tests.web.talk import about

DEVICES, PASSWORD = 12, "correct horse battery"
INVENTED, MESSAGES, BURST_S, INFOS = 6000, 12, 5.0, 2000
PICTURES, BRACKETS, POLLERS = 480, 60_000, 50
#: goals: s, s, s, s, share of the memory before, s
PAGE_S, LOGIN_S, PICTURE_S, HOLE_S, GROWN, STOP_S = 1.0, 2.0, 3.0, 0.3, 0.1, 5.0
#: the ward runs for so long first, until its caches are full; memory is looked at so long after the attack
QUIET_S, MEMORY_S = 40.0, 120.0


@dataclass(slots=True)
class Seen:
    """The longest that each thing took, s, and what failed; by whom it was asked."""

    worst: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    failed: list[str] = field(default_factory=list)

    def asked(self, what: str, ask: Callable[[], tuple[int, bytes]], *good: int) -> None:
        began = time.monotonic()
        try:
            status, body = ask()
        except OSError as error:
            status, body = 0, repr(error).encode()
        self.worst[what] = max(self.worst[what], time.monotonic() - began)
        if status not in good:
            self.failed.append(f"{what}: {status} {body[:80]!r}")


def rss_mb(process: subprocess.Popen[bytes]) -> float:
    """Resident memory of a process."""
    fields = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8").split()
    return int(fields[fields.index("VmRSS:") + 1]) / 1024


@dataclass(slots=True)
class Place:
    """Where an attacker reaches the ward."""

    endpoint: str
    web: int
    seconds: float


def get(port: int, path: str, timeout_s: float = 60.0) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=timeout_s)
    with contextlib.closing(connection):
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.read()


def log_in(port: int) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    with contextlib.closing(connection):
        body = urllib.parse.urlencode({"name": "nurse", "password": PASSWORD, "to": "/"})
        connection.request("POST", "/login", body, {"Content-Type": "application/x-www-form-urlencoded"})
        answer = connection.getresponse()
        return answer.status, answer.read()


# ---- the attacks -----------------------------------------------------------------------------------------------------


def nobody(at: Place) -> None:
    """No attack: what the ward does by itself in the time of `routes`, and the machine to it."""
    time.sleep(at.seconds)


def invented(at: Place) -> None:
    """Small batches of thousands of invented devices in a burst."""
    batches = calibration(after=[]).part(0, 5 * MESSAGES).batches(range(5, 5 * MESSAGES, 5))
    template = f"ghost{0:05d}"
    payloads = [codec.encode_samples(replace(batch, device=template, bridge="ghost")) for batch in batches]
    made = [f"ghost{n:05d}" for n in range(INVENTED)]
    with ZenohBus([at.endpoint]) as bus:
        session, began, sent = bus._session, time.monotonic(), 0
        for payload in payloads:
            for one in made:
                session.put(
                    keys.build(WARD, "raw", bridge="ghost", device=one),
                    payload.replace(template.encode(), one.encode()),
                )
                sent += 1
                if sent % 100 == 0:
                    time.sleep(max(0.0, began + sent * BURST_S / INVENTED / MESSAGES - time.monotonic()))


def infos(at: Place) -> None:
    """What a bridge says of thousands of invented devices."""
    with ZenohBus([at.endpoint]) as bus:
        kept = [bus.publisher(keys.build(WARD, "info", bridge="ghost", device=f"a{n}"), cache=1) for n in range(INFOS)]
        for n, publisher in enumerate(kept):
            publisher.put(codec.encode_info(about(f"a{n}", bridge="ghost", time_ns=time.time_ns())))
        time.sleep(BURST_S)


def brackets(at: Place) -> None:
    """One request with a pattern that is dear to match."""
    with contextlib.suppress(OSError):
        get(at.web, f"/api/v1/devices?only={'[' * BRACKETS}", BURST_S)


def pictures(at: Place) -> None:
    """Hundreds of pictures are asked for and none is waited for."""
    for n in range(PICTURES):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", at.web), 5) as asking:
            path = f"/devices/{name(n % DEVICES)}/bias.png"
            asking.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            time.sleep(BURST_S / PICTURES)


def polls(at: Place) -> None:
    """Many programs at once poll everything that is kept of the ward, and take it compressed."""
    until = time.monotonic() + 4 * BURST_S

    def poll() -> None:
        while time.monotonic() < until:
            connection = http.client.HTTPConnection("127.0.0.1", at.web, timeout=60)
            with contextlib.closing(connection), contextlib.suppress(OSError, http.client.HTTPException):
                connection.request("GET", "/api/v1/stream?after=&wait_s=0", headers={"Accept-Encoding": "gzip"})
                connection.getresponse().read()

    pollers = [threading.Thread(target=poll) for _ in range(POLLERS)]
    for poller in pollers:
        poller.start()
    for poller in pollers:
        poller.join()


def routes(at: Place) -> None:
    """Every route and parameter with long, nested and repeated input; raises RuntimeError where an answer takes long."""
    rng, until, worst, asked = random.Random(1), time.monotonic() + at.seconds, 0.0, 0
    paths = [route.path for route in application_routes() if isinstance(route, Route)] + ["/static/{device}", "/live"]
    slow = dict[str, float]()
    while time.monotonic() < until:
        path = re.sub(
            r"\{(\w+)\}",
            lambda found: name(0) if found[1] == "device" and rng.random() < 0.5 else nasty(rng),
            rng.choice(paths),
        )
        parameters = "&".join(f"{rng.choice(PARAMETERS)}={nasty(rng)}" for _ in range(rng.choice((0, 1, 1, 2, 50))))
        body = rng.choice(
            (
                b"",
                nasty(rng).encode(),
                b"words=" + nasty(rng).encode(),
                b"{" * 15_000,
                b'{"words":"' + nasty(rng).encode(),
            )
        )
        headers = {
            "Content-Type": rng.choice(("application/json", "application/x-www-form-urlencoded", nasty(rng)[:200])),
            rng.choice(("Cookie", "Accept-Language", "Authorization", "X-Csrf-Token", "If-None-Match")): nasty(rng)[
                :8000
            ],
        }
        connection = http.client.HTTPConnection("127.0.0.1", at.web, timeout=60)
        began = time.monotonic()
        with contextlib.closing(connection), contextlib.suppress(OSError, http.client.HTTPException):
            connection.request(rng.choice(("GET", "GET", "POST", "HEAD")), f"{path}?{parameters}", body, headers)
            connection.getresponse().read()
        took, asked = time.monotonic() - began, asked + 1
        if took > (PICTURE_S if path.endswith(".png") else PAGE_S):
            slow[f"{path[:60]}?{parameters[:60]}"] = took
        worst = max(worst, took)
    print(f"routes: {asked} requests, the longest answer took {worst:.2f} s; over {PAGE_S:g} s: {slow}", flush=True)
    if slow:
        sys.exit(1)


def nasty(rng: random.Random) -> str:
    """Text of a kind that is dear to somebody, as it stands in an address."""
    unit = rng.choice(
        (
            "[",
            "*",
            "*a",
            "(",
            "../",
            "%2e%2e%2f",
            "%00",
            "a",
            "0",
            "9",
            "{",
            "%ff",
            "?",
            ";",
            "=",
            ",",
            "%F0%9F%92%A9",
            "-",
            ".",
            "x;q=0.1,",
            "%0d%0a",
        )
    )
    return unit * rng.choice((1, 2, 30, 64, 300, 1000, 10_000 // len(unit)))


PARAMETERS = ("only", "before", "limit", "to", "lang", "words", "x")
ATTACKS: dict[str, Callable[[Place], None]] = {
    "nobody": nobody,
    "invented": invented,
    "infos": infos,
    "brackets": brackets,
    "pictures": pictures,
    "polls": polls,
    "routes": routes,
}


# ---- the ward --------------------------------------------------------------------------------------------------------


def send(endpoint: str, stop: Event) -> None:
    """What a bridge would, in a process of its own."""
    fleet = Fleet(DEVICES, 104.0, 5)
    with ZenohBus([endpoint]) as bus:
        publishers = [bus.publisher(key, cache=100) for key in fleet.keys]
        due, number = time.monotonic(), 0
        while not stop.is_set():
            for i, payload in fleet.round(number, time.time_ns()):
                publishers[i].put(payload)
            number += 1
            due += fleet.period_s
            time.sleep(max(0.0, due - time.monotonic()))


@contextlib.contextmanager
def bridge(endpoint: str) -> Iterator[None]:
    spawned = multiprocessing.get_context("spawn")
    stop = spawned.Event()
    sending = spawned.Process(target=send, args=(endpoint, stop), daemon=True)
    sending.start()
    try:
        yield
    finally:
        stop.set()
        sending.join(10)
        sending.kill()


def visit(web: int, health: int, seen: Seen, over: threading.Event) -> None:
    n = 0
    while not over.wait(1.0):
        n += 1
        seen.asked("page", lambda: get(web, "/"), 200)
        if n % 3 == 0:
            seen.asked("login", lambda: log_in(web), 303)
        if n % 5 == 0:
            seen.asked("picture", lambda: get(web, f"/devices/{name(0)}/bias.png"), 200)
        seen.asked("readyz", lambda: get(health, "/readyz"), 200)


def holes(heard: list[tuple[int, str, bytes]], until_ns: int) -> dict[str, float]:
    """Of each real device the longest time in which nothing of it came, s."""
    last: dict[str, int] = {}
    found = dict.fromkeys((name(i) for i in range(DEVICES)), 0.0)
    for now_ns, key, _ in heard:
        device = key.rpartition("/")[2]
        if device in found:
            found[device] = max(found[device], (now_ns - last.get(device, now_ns)) / 1e9)
            last[device] = now_ns
    return {device: max(hole, (until_ns - last.get(device, heard[0][0])) / 1e9) for device, hole in found.items()}


def run(which: str, after_s: float, fuzz_s: float) -> list[str]:
    """What was not reached."""
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        folder, endpoint = Path(place), f"tcp/127.0.0.1:{free_port()}"
        web, health = free_port(), free_port()
        config = folder / "ward.toml"
        config.write_text(
            f'ward = "{WARD}"\n[bus]\nconnect = ["{endpoint}"]\n[router]\nlisten = ["{endpoint}"]\n'
            f'[estimator]\nid = "e"\nstore = "{folder}/store.sqlite3"\nhealth = "127.0.0.1:{health}"\n'
            f'[dashboard]\nlisten = "127.0.0.1:{web}"\n'
            f'[[dashboard.people]]\nname = "nurse"\npassword = "{hashed(PASSWORD)}"\n'
        )
        stack.enter_context(process("estimator.cli.main", "router", "--config", str(config), log=folder / "router.log"))
        if not listens(endpoint, 20.0):
            raise RuntimeError("the router does not listen")
        log = folder / "estimator.log"
        estimator = stack.enter_context(process("estimator.cli.main", "estimator", "serve", str(config), log=log))
        dashboard = stack.enter_context(
            process("estimator.cli.main", "dashboard", "--config", str(config), log=folder / "dashboard.log")
        )
        until = time.monotonic() + 40
        while "serves ward" not in log.read_text() or not listens(f"tcp/127.0.0.1:{web}", 1.0):
            if time.monotonic() > until:
                raise RuntimeError(log.read_text() + (folder / "dashboard.log").read_text())
            time.sleep(0.1)
        healthy = Healthy(endpoint)
        stack.callback(healthy.close)
        stack.enter_context(bridge(endpoint))
        seen, over, calm = Seen(), threading.Event(), Seen()
        time.sleep(QUIET_S)
        visit_once(web, health, calm)
        before = {"estimator": rss_mb(estimator), "dashboard": rss_mb(dashboard)}
        healthy.heard.clear()
        visitor = threading.Thread(target=visit, args=(web, health, seen, over), daemon=True)
        visitor.start()
        began = time.monotonic()
        attacker = multiprocessing.get_context("spawn").Process(
            target=ATTACKS[which], args=(Place(endpoint, web, fuzz_s),)
        )
        attacker.start()
        attacker.join(120 + fuzz_s)
        attacker.kill()
        time.sleep(min(after_s, MEMORY_S))
        after = {"estimator": rss_mb(estimator), "dashboard": rss_mb(dashboard)}
        time.sleep(max(0.0, after_s - MEMORY_S))
        longest = holes(healthy.heard, time.time_ns())
        over.set()
        visitor.join(120)
        lasted = time.monotonic() - began
        status, page = get(web, "/")
        stopping = time.monotonic()
        estimator.send_signal(signal.SIGINT)
        estimator.wait(120)
        stopped_s = time.monotonic() - stopping
        worst = {what: round(seen.worst[what], 2) for what in ("page", "login", "picture", "readyz")}
        print(f"{which}, {lasted:.0f} s:")
        print(f"  quiet, first asked: { {what: round(s, 2) for what, s in calm.worst.items()} }")
        print(f"  worst, s: {worst}; hole {max(longest.values()):.2f} s; stopped in {stopped_s:.1f} s")
        print(
            f"  MB before: { {k: round(v) for k, v in before.items()} }, after: { {k: round(v) for k, v in after.items()} }"
        )
        print(
            f"  the page: {status}, {len(page)} bytes, all devices on it: {all(name(i).encode() in page for i in range(DEVICES))}"
        )
        print(
            f"  log: {len(log.read_bytes())} bytes, {len(log.read_text().splitlines())} lines; failed: {seen.failed[:5]}",
            flush=True,
        )
        goals = {"page": PAGE_S, "login": LOGIN_S, "picture": PICTURE_S}
        missed = [f"{what} {worst[what]:g} s (goal {goal:g})" for what, goal in goals.items() if worst[what] > goal]
        missed += [f"hole of {max(longest.values()):.2f} s (goal {HOLE_S:g})"] * (max(longest.values()) > HOLE_S)
        missed += [
            f"{who} {before[who]:.0f} MB before, {after[who]:.0f} after"
            for who in before
            if after[who] > (1 + GROWN) * before[who]
        ]
        missed += [f"stopped in {stopped_s:.1f} s (goal {STOP_S:g})"] * (stopped_s > STOP_S)
        missed += ["an answer took longer than 1 s"] * bool(attacker.exitcode)
        missed += seen.failed[:3]
        return missed


def visit_once(web: int, health: int, seen: Seen) -> None:
    seen.asked("page", lambda: get(web, "/"), 200)
    seen.asked("login", lambda: log_in(web), 303)
    seen.asked("picture", lambda: get(web, f"/devices/{name(0)}/bias.png"), 200)
    seen.asked("readyz", lambda: get(health, "/readyz"), 200)


def main() -> int:
    """1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=ATTACKS, default=list(ATTACKS))
    parser.add_argument("--after", type=float, default=130.0, help="seconds the ward is watched for after each attack")
    parser.add_argument("--fuzz", type=float, default=600.0, help="seconds of `routes` and `nobody`")
    given: Any = parser.parse_args()
    missed = {which: found for which in given.only if (found := run(which, given.after, given.fuzz))}
    for which, found in missed.items():
        print(f"not reached, {which}: {'; '.join(found)}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
