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
import sys
import tempfile
import threading
import time
import urllib.parse
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from starlette.routing import Route

from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import codec, keys
from estimator.demo.ward import free_port, listens
from estimator.web.app import routes as application_routes
from estimator.web.passwords import hashed
from tests.bench.load.receiver import Receiver
from tests.bench.load.stream import WARD, name
from tests.bench.programs import CLI, estimator, program, router, rss_mb, ward_file
from tests.bench.suffering import longest_silence_s
from tests.estimator.stream import calibration
from tests.web.talk import about

DEVICES, PASSWORD = 12, "correct horse battery"
INVENTED, MESSAGES, BURST_S, INFOS = 6000, 12, 5.0, 2000
PICTURES, BRACKETS, POLLERS = 480, 60_000, 50
#: goals, s: of answers, of a hole, of stopping; and of the memory before
GOALS_S = {"page": 1.0, "login": 2.0, "picture": 3.0, "hole": 0.3, "stop": 5.0}
GROWN = 0.1
#: the ward runs for so long first, until its caches are full; memory is looked at so long after the attack
QUIET_S, MEMORY_S = 40.0, 120.0


@dataclass(slots=True)
class Place:
    """Where an attacker reaches the ward."""

    endpoint: str
    web: int
    seconds: float


def ask(
    port: int, path: str, verb: str = "GET", body: bytes = b"", headers: Mapping[str, str] | None = None
) -> tuple[int, bytes]:
    """Status and content of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    with contextlib.closing(connection):
        connection.request(verb, path, body or None, headers or {})
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
        ask(at.web, f"/api/v1/devices?only={'[' * BRACKETS}")


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
            with contextlib.suppress(OSError, http.client.HTTPException):
                ask(at.web, "/api/v1/stream?after=&wait_s=0", headers={"Accept-Encoding": "gzip"})

    pollers = [threading.Thread(target=poll) for _ in range(POLLERS)]
    for poller in pollers:
        poller.start()
    for poller in pollers:
        poller.join()


def routes(at: Place) -> None:
    """Every route and parameter with long, nested and repeated input; ends with exit code 1 where an answer takes long."""
    rng, until, asked, slow = random.Random(1), time.monotonic() + at.seconds, 0, dict[str, float]()
    paths = [route.path for route in application_routes() if isinstance(route, Route)] + ["/static/{device}", "/live"]
    while time.monotonic() < until:
        path = re.sub(r"\{\w+\}", lambda _: rng.choice((name(0), nasty(rng))), rng.choice(paths))
        parameters = "&".join(f"{rng.choice(PARAMETERS)}={nasty(rng)}" for _ in range(rng.choice((0, 1, 1, 2, 50))))
        body = rng.choice(("", nasty(rng), f"words={nasty(rng)}", "{" * 15_000, '{"words":"' + nasty(rng)))
        kinds = ("application/json", "application/x-www-form-urlencoded", nasty(rng)[:200])
        headers = {"Content-Type": rng.choice(kinds), rng.choice(HEADERS): nasty(rng)[:8000]}
        began = time.monotonic()
        with contextlib.suppress(OSError, http.client.HTTPException):
            ask(at.web, f"{path}?{parameters}", rng.choice(("GET", "GET", "POST", "HEAD")), body.encode(), headers)
        took_s, asked = time.monotonic() - began, asked + 1
        if took_s > GOALS_S["picture" if path.endswith(".png") else "page"]:
            slow[f"{path[:60]}?{parameters[:60]}"] = took_s
    print(f"routes: {asked} requests; slow: {slow}", flush=True)
    if slow:
        sys.exit(1)


#: dear to somebody, as it stands in an address
_NASTY = (
    *(
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
        "-",
        ".",
        "x;q=0.1,",
    ),
    *("%F0%9F%92%A9", "%0d%0a"),
)


def nasty(rng: random.Random) -> str:
    """Text of one such kind, again and again."""
    unit = rng.choice(_NASTY)
    return unit * rng.choice((1, 2, 30, 64, 300, 1000, 10_000 // len(unit)))


HEADERS = ("Cookie", "Accept-Language", "Authorization", "X-Csrf-Token", "If-None-Match")
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


class Visitor(threading.Thread):
    """Asks every second; keeps the longest that each thing took, s, and what failed."""

    def __init__(self, web: int, health: int) -> None:
        super().__init__(daemon=True)
        self._web, self._health = web, health
        self.worst: dict[str, float] = defaultdict(float)
        self.failed: list[str] = []
        self._over = threading.Event()

    def run(self) -> None:
        n = 0
        while not self._over.wait(1.0):
            n += 1
            self.visit(logs_in=n % 3 == 0, looks=n % 5 == 0)

    def visit(self, *, logs_in: bool = True, looks: bool = True) -> None:
        """Ask for the ward's page and `/readyz`; log in and look at a picture if that is wanted."""
        self._asked("page", 200, self._web, "/")
        if logs_in:
            words = urllib.parse.urlencode({"name": "nurse", "password": PASSWORD, "to": "/"}).encode()
            self._asked("login", 303, self._web, "/login", words)
        if looks:
            self._asked("picture", 200, self._web, f"/devices/{name(0)}/bias.png")
        self._asked("readyz", 200, self._health, "/readyz")

    def _asked(self, what: str, good: int, port: int, path: str, form: bytes = b"") -> None:
        began = time.monotonic()
        headers = {"Content-Type": "application/x-www-form-urlencoded"} if form else {}
        try:
            status, content = ask(port, path, "POST" if form else "GET", form, headers)
        except OSError as error:
            status, content = 0, repr(error).encode()
        self.worst[what] = max(self.worst[what], time.monotonic() - began)
        if path == "/" and not all(name(i).encode() in content for i in range(DEVICES)):
            self.failed.append("page: devices are missing")
        if status != good:
            self.failed.append(f"{what}: {status} {content[:80]!r}")

    def close(self) -> None:
        self._over.set()
        self.join(120)


def run(which: str, after_s: float, fuzz_s: float) -> list[str]:
    """What was not reached."""
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        folder, endpoint, web, health = Path(place), f"tcp/127.0.0.1:{free_port()}", free_port(), free_port()
        file = ward_file(
            folder, WARD, endpoint,
            f'health = "127.0.0.1:{health}"\n[dashboard]\nlisten = "127.0.0.1:{web}"\n'
            f'[[dashboard.people]]\nname = "nurse"\npassword = "{hashed(PASSWORD)}"\n',
        )  # fmt: skip
        stack.enter_context(router(file, endpoint))
        serving = stack.enter_context(estimator(file))
        page = stack.enter_context(program(CLI, "dashboard", "--config", str(file), log=folder / "dashboard.log"))
        listens(f"tcp/127.0.0.1:{web}", 40.0)
        healthy, visitor = Receiver(endpoint), Visitor(web, health)
        stack.callback(healthy.close)
        words = [endpoint, str(DEVICES), "104.0", "5", "paced", str(QUIET_S + 300.0 + fuzz_s + after_s), "0"]
        stack.enter_context(program("tests.bench.load.sender", *words))
        time.sleep(QUIET_S)
        visitor.visit()  # the first picture loads the libraries that draw
        print(f"{which}: quiet, first asked, s: { {what: round(s, 2) for what, s in visitor.worst.items()} }")
        visitor.worst.clear()
        before = [rss_mb(each.pid) for each in (serving, page)]
        since_ns = time.time_ns()
        visitor.start()
        attacker = multiprocessing.get_context("spawn").Process(
            target=ATTACKS[which], args=(Place(endpoint, web, fuzz_s),)
        )
        attacker.start()
        attacker.join(120 + fuzz_s)
        attacker.kill()
        time.sleep(min(after_s, MEMORY_S))
        after = [rss_mb(each.pid) for each in (serving, page)]
        time.sleep(max(0.0, after_s - MEMORY_S))
        holes = longest_silence_s(healthy.heard, {name(i) for i in range(DEVICES)}, since_ns, time.time_ns())
        visitor.close()
        stopping = time.monotonic()
        serving.send_signal(signal.SIGINT)
        serving.wait(120)
        worst = {**visitor.worst, "hole": max(holes.values()), "stop": time.monotonic() - stopping}
    print(f"{which}: worst, s: { {what: round(s, 2) for what, s in worst.items()} }; ", end="")
    print(f"estimator and dashboard, MB, before {before}, after {after}; failed: {visitor.failed[:5]}", flush=True)
    missed = [
        f"{what} {worst[what]:.2f} s (goal {goal:g})" for what, goal in GOALS_S.items() if worst.get(what, 0.0) > goal
    ]
    missed += [
        f"{was:.0f} MB, then {now:.0f}" for was, now in zip(before, after, strict=True) if now > (1 + GROWN) * was
    ]
    missed += ["an answer took longer than its goal"] * bool(attacker.exitcode)
    return missed + visitor.failed[:3]


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
