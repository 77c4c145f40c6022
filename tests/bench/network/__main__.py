"""Two routers over TLS and a network that fails: what is lost, given twice, out of order, for how long. `make bench-network`.

Every machine of the ward has a network of its own (kernel namespaces, which need root): two routers, a bridge, an estimator and a
subscriber on either side. After each trouble the network is whole again, and it ends when all that was said has come.
"""

import argparse
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from bridge.terminal.tables import Column, Columns
from tests.bench.network.guarded import ROUTERS, Guarded, guarded
from tests.bench.network.judge import disputed_until, judged
from tests.bench.network.lan import impossible

LOSS, HOLE_S, PARTED_S = 0.3, 4.0, 10.0
#: every device has one owner so soon after a line that was cut is whole
OWNER_S = 2.0


def killed(ward: Guarded) -> None:
    ward.kill("r1")
    time.sleep(5.0)
    ward.start("r1")


def restarted(ward: Guarded) -> None:
    for router in ROUTERS:
        ward.stop(router)
        ward.start(router)
        time.sleep(5.0)


def hole(*machines: str, share: float = 1.0, for_s: float = HOLE_S) -> Callable[[Guarded], None]:
    def do(ward: Guarded) -> None:
        for machine in machines:
            ward.lan.lose(machine, share)
        time.sleep(for_s)
        for machine in machines:
            ward.lan.lose(machine, 0.0)

    return do


def parted(ward: Guarded) -> None:
    ward.lan.part(parted=True)
    time.sleep(PARTED_S)
    ward.lan.part(parted=False)


def stopped_estimator(ward: Guarded) -> None:
    ward.until(ward.home, 120.0)  # over a line that was bad lately it has none for a while
    ward.send("e1", signal.SIGSTOP)
    time.sleep(5.0)
    ward.send("e1", signal.SIGCONT)


TROUBLES: dict[str, Callable[[Guarded], None]] = {
    "nothing": lambda _: time.sleep(5.0),
    "a router killed": killed,
    "both routers restarted": restarted,
    "4 s black hole, a router": hole("r1"),
    "4 s black hole, both": hole(*ROUTERS),
    "30 % loss, a bridge": hole("b1", share=LOSS, for_s=15.0),
    "30 % loss, an estimator": hole("e1", share=LOSS, for_s=15.0),
    "30 % loss, a subscriber": hole("v1", share=LOSS, for_s=15.0),
    "30 % loss, both routers": hole(*ROUTERS, share=LOSS, for_s=15.0),
    "an estimator hangs": stopped_estimator,
    "10 s parted": parted,
}


def main() -> int:
    """1 when a promise was broken, or a goal missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=4, help="of each of the two bridges")
    parser.add_argument("--speed", type=float, default=2.0, help="of the devices' life")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--only", default="", help="troubles with these words in their names")
    args = parser.parse_args()
    console = Console(width=150)
    if why := impossible():
        console.print(f"skipped: {why}")
        return 0
    words = (
        "at",
        "samples",
        "gap",
        "whole after",
        "one owner",
        "moves",
        "lost",
        "twice",
        "order",
        "late",
        "broken",
    )
    table = Columns([Column("what"), *(Column(word, number=True) for word in words)])
    broken, missed = 0, []
    folder = Path(tempfile.mkdtemp(prefix="network-"))
    with guarded(folder, args.devices, args.speed) as ward:
        for name, trouble in [one for one in TROUBLES.items() if args.only in one[0]] * args.rounds:
            since_s = time.monotonic()
            time.sleep(1.0)
            trouble(ward)
            mended_s = time.monotonic()
            try:
                ward.until(ward.current, 60.0)
            except RuntimeError as error:
                broken += 1
                console.print(f"{name}: {error}")
            whole_s = time.monotonic() - mended_s
            time.sleep(4.0)
            devices = [device for of_bridge in ward.devices.values() for device in of_bridge]
            owner_s = disputed_until(ward.heard.values(), devices, since_s, time.monotonic()) - mended_s
            if trouble is parted and owner_s > OWNER_S:
                missed.append(f"{name}: one owner of each device after {owner_s:.1f} s (goal {OWNER_S:g} s)")
            for viewer, heard in ward.heard.items():
                found = judged(heard, since_s)
                broken += bool(found.broken)
                table.add(
                    name,
                    viewer,
                    f"{found.samples:,}",
                    f"{found.gap_s:.2f} s",
                    f"{whole_s:.1f} s",
                    f"{max(0.0, owner_s):.1f} s",
                    str(ward.moves(viewer, since_s)),
                    *(str(n) for n in (found.lost, found.twice, found.out_of_order, found.late)),
                    found.broken,
                )
            console.print(f"{name}: done")
    console.print(table)
    if missed:
        console.print(f"not reached: {'; '.join(missed)}")
    if broken:
        console.print(f"logs are in {folder}")
    return int(bool(broken or missed))


if __name__ == "__main__":
    sys.exit(main())
