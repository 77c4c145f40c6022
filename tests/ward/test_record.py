"""A recorder that is killed, or whose disk is full. What subscribers got is in its file: test_recovery.py."""

import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.recording.survey import survey
from bridge.wire import keys
from estimator.demo.ward import WARD, free_port
from tests.bridge.recording import crowd
from tests.bridge.recording.kills import killed

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(240)]


def recorder(endpoint: str, folder: Path, *words: str, ward: str = WARD, file_limit: int = 0) -> subprocess.Popen[str]:
    """`truerate record` as a process; file_limit in bytes, 0 for none."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))

    command = [sys.executable, "-m", "estimator.cli.main", "record", "--ward", ward, "--connect", endpoint]
    return subprocess.Popen(
        [*command, "--out", str(folder), "--wait", "30", *words],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=limited if file_limit else None,  # noqa: PLW1509 - no threads of ours hold a lock here
    )


#: by so much a busy machine may be late; `tests/bench/kills.py` measures the second
BUSY_S = 3.0


def test_a_killed_recorder_has_lost_a_second_at_most() -> None:
    results = list(killed(4, 4, f"tcp/127.0.0.1:{free_port()}", seed=int(time.time())))
    assert len(results) == 4
    for result in results:
        assert result.lost_s < 1.0 + BUSY_S, result
        assert result.missing == 0, result


def test_a_file_that_may_not_grow_is_followed_by_another(tmp_path: Path) -> None:
    """A real limit of the kernel's: the message says so, nothing is torn, and recording goes on."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Router((endpoint,), shed=keys.VIEWED), ZenohBus((endpoint,)) as bus, crowd.Crowd(bus, 20):
        process = recorder(endpoint, tmp_path, "--seconds", "4", ward=crowd.WARD, file_limit=300_000)
        _, said = process.communicate(timeout=60)
    assert "may not grow further" in said
    assert process.returncode == 1, "something was not recorded, and that is told"
    files = sorted(tmp_path.iterdir())
    assert len(files) > 1
    found = survey(files)
    assert len(found.devices) == 20
    assert sum(boot.samples for device in found.devices.values() for boot in device.boots.values()) > 20 * 200
