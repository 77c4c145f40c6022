"""A recorder in a real ward: what subscribers got is in its file, also when it is killed, or the disk is full."""

import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.recording import load
from bridge.recording.stretches import read
from bridge.recording.survey import survey
from bridge.wire import keys
from bridge.wire.messages import Quality
from estimator.cli.main import main
from estimator.demo.subscribers import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward, free_port
from estimator.offline.recordings import correct
from tests.bridge.recording import crowd
from tests.bridge.recording.kills import killed
from tests.ward.parts import living, numbers, wait

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(240)]
NAME = "wrist"


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


def ended(process: subprocess.Popen[str]) -> str:
    """Stop a recorder as Ctrl-C does; what it said."""
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    return said


def test_a_ward_is_recorded_as_subscribers_got_it(tmp_path: Path) -> None:
    (tmp_path / "rec").mkdir()
    with Ward(tmp_path, (NAME,)) as ward:
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        watcher, heard = Watcher(ward.endpoint, WARD), Subscriber(ward.endpoint, WARD, keep=True)
        process = recorder(ward.endpoint, tmp_path / "rec")
        try:
            ward.plug(NAME, living(NAME, seed=3), speed=10.0, lossless=True)
            wait("a calibration", lambda: watcher.all_tracking(1), watcher, ward)
            assert main(["note", NAME, "sat up", "--ward", WARD, "--connect", ward.endpoint]) == 0
            wait("good samples", lambda: _good(heard) > 500, watcher, ward)
        finally:
            heard.close()
            said = ended(process)
            watcher.close()
    assert process.returncode == 0, said
    (path,) = (tmp_path / "rec").glob("*.mcap")
    recorded = read([path])
    (stretch,) = recorded.stretches[NAME]
    [got] = heard.batches.values()
    assert np.isin(numbers(got), stretch.sequence).all(), "what was heard is in the file"
    known = np.isin(stretch.sequence, numbers(got))
    assert (np.diff(stretch.sequence) == 1).all()
    assert stretch.corrected is not None
    rates = np.concatenate([batch.rate for batch in got])[np.isin(numbers(got), stretch.sequence)]
    np.testing.assert_array_equal(stretch.corrected.rate[known], rates)
    assert [note.text for note in recorded.notes] == ["sat up"]
    assert [c.verdict.name for c in recorded.calibrations] == ["ACCEPTED"]
    # The recorded readings, corrected again, come out as they did live, once calibrated.
    again = correct(load(path), recorded.calibrations[0], gyro_range=stretch.info.gyro_range if stretch.info else 0)
    good = (stretch.corrected.quality == Quality.GOOD) & (again.quality == Quality.GOOD)
    assert good.any()
    assert np.degrees(np.abs(again.rate - stretch.corrected.rate)[good]).max() < 0.3


def _good(heard: Subscriber) -> int:
    return sum(len(b) for batches in heard.batches.values() for b in batches if b.quality is Quality.GOOD)


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
