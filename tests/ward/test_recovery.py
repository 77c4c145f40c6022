"""A recorded ward; cables pulled, processes killed: each comes back by itself, with its calibration, or asks for a new one."""

import signal
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.recording import load
from bridge.recording.stretches import read
from bridge.wire.messages import Quality, State
from estimator.client import Client
from estimator.demo.subscribers import Subscriber, Watcher
from estimator.demo.ward import WARD, Ward
from estimator.offline.recordings import correct
from tests.ward.parts import good_calibrations, living, numbers, wait
from tests.ward.test_record import recorder

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward"), pytest.mark.timeout(240)]
NAME = "wrist"
SPEED = 10.0


@dataclass
class Running:
    """A ward with one device that is calibrated."""

    ward: Ward
    watcher: Watcher
    subscriber: Subscriber
    recorder: subprocess.Popen[str]
    calibration: str

    def wait(self, what: str, until: Callable[[], bool]) -> float:
        return wait(what, until, self.watcher, self.ward)

    def good_samples(self) -> int:
        return sum(len(b) for batches in self.subscriber.batches.values() for b in batches if b.quality is Quality.GOOD)

    def more_good(self, what: str) -> float:
        """Until more GOOD samples come than were there."""
        before = self.good_samples()
        return self.wait(f"more good samples after {what}", lambda: self.good_samples() > before + 50)

    def restart(self, part: str) -> None:
        self.ward.stop(part, signal.SIGKILL)
        self.ward.start(part)
        self.more_good(f"a restart of the {part}")

    def steps(self) -> NDArray[np.int64]:
        """From number to number of the first boot's samples, as received."""
        return np.diff(numbers(next(iter(self.subscriber.batches.values()))))

    def calibrations(self) -> list[str]:
        return [name for batches in self.subscriber.batches.values() for name in good_calibrations(batches)]


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with Ward(tmp_path, (NAME,)) as ward:
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        (tmp_path / "rec").mkdir()
        watcher, subscriber = Watcher(ward.endpoint, WARD), Subscriber(ward.endpoint, WARD, keep=True)
        process = recorder(ward.endpoint, tmp_path / "rec")
        # A machine that is busy must not cost bytes: what is lost here, we have lost.
        ward.plug(NAME, living(NAME, seed=3), speed=SPEED, lossless=True)
        try:
            wait("a calibration", lambda: watcher.all_tracking(1), watcher, ward)
            yield Running(ward, watcher, subscriber, process, watcher.statuses[NAME].calibration)
        finally:
            process.kill()
            process.communicate()
            subscriber.close(0.5)
            watcher.close()


def what_subscribers_got_is_recorded(running: Running) -> None:
    with Client((running.ward.endpoint,), ward=WARD) as client:
        assert client.note(NAME, "nurse", "sat up").accepted
    running.wait("good samples", lambda: running.good_samples() > 500)
    [got] = [list(batches) for batches in running.subscriber.batches.values()]
    running.more_good("these")
    running.recorder.send_signal(signal.SIGINT)
    _, said = running.recorder.communicate(timeout=60)
    assert running.recorder.returncode == 0, said
    (path,) = (running.ward.folder / "rec").glob("*.mcap")
    recorded = read([path])
    (stretch,) = recorded.stretches[NAME]
    assert (np.diff(stretch.sequence) == 1).all()
    assert np.isin(numbers(got), stretch.sequence).all(), "what was heard is in the file"
    known = np.isin(stretch.sequence, numbers(got))
    np.testing.assert_array_equal(stretch.computed["rate_rad_s"][known], np.concatenate([batch.rate for batch in got]))
    assert [note.text for note in recorded.notes] == ["sat up"]
    assert [c.verdict.name for c in recorded.calibrations] == ["ACCEPTED"]
    # The recorded readings, corrected again, come out as they did live, once calibrated.
    again = correct(load(path), recorded.calibrations[0], gyro_range=stretch.info.gyro_range if stretch.info else 0)
    good = (stretch.computed["quality"] == Quality.GOOD) & (again.quality == Quality.GOOD)
    assert good.any()
    assert np.degrees(np.abs(again.rate - stretch.computed["rate_rad_s"])[good]).max() < 0.3


def test_whatever_is_killed_pulled_or_asked_for_it_goes_on_and_after_a_reboot_anew(running: Running) -> None:
    what_subscribers_got_is_recorded(running)
    running.restart("router")
    assert running.subscriber.troubles == ""
    running.restart("estimator")
    assert set(running.steps()) == {1}, "nothing lost, nothing twice"
    running.restart("bridge")
    running.ward.ports[NAME].unplug()
    running.wait("the loss", lambda: running.watcher.statuses[NAME].state is State.LOST)
    running.ward.ports[NAME].plug()
    running.more_good("replugging")
    steps = running.steps()
    assert np.all(steps > 0), "in order, nothing twice"
    assert (steps > 1).sum() <= 2, "what a device sends while no bridge reads its port is gone, and no more"

    with Client((running.ward.endpoint,), ward=WARD) as client:
        reply = client.recalibrate(NAME, "a nurse", "fell down")
        assert reply.accepted, reply.message
        running.wait("the request", lambda: running.watcher.statuses[NAME].state is not State.TRACKING)
        running.more_good("asking for a recalibration")
        reply = client.cancel(NAME, "a nurse")
        assert reply.accepted, reply.message
        assert not client.recalibrate("nobody", "a nurse").accepted
    running.wait("the cancel", lambda: running.watcher.statuses[NAME].state is State.TRACKING)
    assert running.calibrations() == [running.calibration], "the same all the time"
    assert len(running.subscriber.batches) == 1, "the same boot"

    running.ward.ports[NAME].device.reboot()
    running.wait("the reboot", lambda: len(running.subscriber.batches) == 2)
    running.wait(
        "the new calibration",
        lambda: running.watcher.all_tracking(1) and running.watcher.statuses[NAME].calibration != running.calibration,
    )
    running.more_good("the new calibration")
    _, new = running.subscriber.batches.values()
    qualities = [batch.quality for batch in new]
    assert qualities[0] in (Quality.NONE, Quality.PRIOR)
    first_good = qualities.index(Quality.GOOD)
    assert all(batch.calibration != running.calibration for batch in new[first_good:])
    assert Quality.BIAS_ONLY in qualities[:first_good]
