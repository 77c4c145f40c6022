"""Two routers over TLS, on a network of their own: one is killed, the line between them is cut; nobody misses anything.

The short form of `make bench-network`.
"""

import time
from pathlib import Path

import pytest

from tests.bench.network.guarded import VIEWERS, guarded
from tests.bench.network.judge import judged
from tests.bench.network.lan import impossible

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("network"), pytest.mark.timeout(240)]


def test_a_router_that_is_killed_and_a_cut_between_two_are_missed_by_nobody(tmp_path: Path) -> None:
    if why := impossible():
        pytest.skip(why)
    with guarded(tmp_path, devices=1, speed=6.0) as ward:
        since_s = time.monotonic()
        ward.kill("r1")
        time.sleep(1.0)
        ward.start("r1")
        ward.until(ward.current, 60.0)
        ward.lan.part(parted=True)
        time.sleep(3.0)
        ward.lan.part(parted=False)
        ward.until(ward.current, 60.0)
        time.sleep(1.0)
        for viewer in VIEWERS:
            found = judged(ward.heard[viewer], since_s)
            assert not found.broken, found
            assert found.late, "what was on the other side came late"
