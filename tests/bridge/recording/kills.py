"""Recorders killed at random moments, over a real router: what of that which was sent is in the recovered files."""

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.recording.error import RecordingError
from bridge.recording.recover import recover
from bridge.recording.survey import survey
from bridge.wire import keys
from tests.bridge.recording.crowd import RATE_HZ, WARD, Crowd

DEVICES = 5


class Killed(NamedTuple):
    """A recorder that was killed: seconds of what was sent that are not in its file, of the device that lost most."""

    lasted_s: float
    lost_s: float
    missing: int  # samples missing within
    trouble: tuple[str, ...]


def killed(rounds: int, at_once: int, endpoint: str, seed: int, longest_s: float = 3.0) -> Iterator[Killed]:
    """So many recorders, some at once, each killed after a random time of recording."""
    chance = random.Random(seed)
    with Router((endpoint,), shed=keys.VIEWED), ZenohBus((endpoint,)) as bus, Crowd(bus, DEVICES) as crowd:
        for first in range(0, rounds, at_once):
            with tempfile.TemporaryDirectory() as name:
                folders = [Path(name) / str(number) for number in range(min(at_once, rounds - first))]
                yield from _one_go(folders, endpoint, crowd, chance, longest_s)


def _one_go(
    folders: list[Path], endpoint: str, crowd: Crowd, chance: random.Random, longest_s: float
) -> Iterator[Killed]:
    recorders = []
    for folder in folders:
        folder.mkdir()
        words = ["record", "--ward", WARD, "--connect", endpoint, "--out", str(folder), "--rotate", "10s"]
        recorders.append(
            subprocess.Popen([sys.executable, "-m", "estimator.cli.main", *words], stderr=subprocess.DEVNULL)
        )
    try:
        deadline = time.monotonic() + 60
        while not all(any(folder.iterdir()) for folder in folders):
            assert time.monotonic() < deadline, "no recorder has begun"
            time.sleep(0.02)
        began = time.monotonic()
        moments = sorted((began + chance.uniform(0.0, longest_s), at) for at in range(len(folders)))
        for moment, at in moments:
            time.sleep(max(0.0, moment - time.monotonic()))
            recorders[at].send_signal(signal.SIGKILL)
            recorders[at].wait(60)
            yield _what_is_left(folders[at], crowd, time.monotonic(), began)
    finally:
        for recorder in recorders:
            recorder.kill()
            recorder.wait(60)


def _what_is_left(folder: Path, crowd: Crowd, moment_s: float, began_s: float) -> Killed:
    sent = crowd.sent_by(moment_s)
    trouble: tuple[str, ...] = ()
    for part in folder.glob("*.part"):
        try:
            trouble = recover(part).trouble
        except RecordingError as error:
            trouble = (str(error),)  # nothing was written yet
    found = survey(sorted(folder.glob("*.mcap")))
    boots = {name: device.boots[7] for name, device in found.devices.items() if device.boots}
    before = crowd.sent_by(began_s)
    # What was sent before there was a file comes from caches while it begins: it counts from then on.
    last = min(max(before, boots[name].end) if name in boots else before for name in crowd.names)
    return Killed(moment_s - began_s, (sent - last) / RATE_HZ, sum(boot.missing for boot in boots.values()), trouble)
