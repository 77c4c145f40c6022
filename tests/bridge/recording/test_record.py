"""`truerate record` around its core: from a bus into a folder, or a sentence that says why not."""

import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bridge.bucket.bucket import Bucket
from bridge.bus.contract import BusError
from bridge.config.schema import Root
from bridge.recording.error import RecordingError
from bridge.recording.record import record
from bridge.recording.settings import Recorder, seconds
from bridge.recording.survey import survey
from bridge.toml.loader import ConfigError, load
from tests.bridge.bucket.server import Server, needed
from tests.bridge.bus.worlds import eventually
from tests.bridge.recording.crowd import WARD, Crowd
from tests.memory_bus import MemoryBroker, MemoryBus

NOWHERE = ("tcp/127.0.0.1:1",)


class Run:
    """A recorder on a bus in memory."""

    def __init__(self, folder: Path, **settings: object) -> None:
        self.broker = MemoryBroker()
        given = {"folder": str(folder), "wait_s": 0.3, "keep_free_mb": 0, **settings}
        self.settings = Recorder(**given)  # type: ignore[arg-type] # as a test gives them
        self.said = io.StringIO()

    def open(self, _endpoints: Sequence[str]) -> MemoryBus:
        return MemoryBus(self.broker)

    def record(self, for_s: float, bucket: Bucket | None = None) -> int:
        console = Console(file=self.said, width=200)
        return record(WARD, NOWHERE, self.settings, console, seconds=for_s, open_bus=self.open, bucket=bucket)


def test_what_is_said_is_recorded_from_the_caches_on(tmp_path: Path) -> None:
    run = Run(tmp_path, wait_s=10.0)
    with MemoryBus(run.broker) as bus, Crowd(bus, 3) as crowd:
        eventually(lambda: bool(crowd.sent))
        assert run.record(1.2) == 0
    (path,) = tmp_path.iterdir()
    assert path.suffix == ".mcap"
    steps = np.diff([n for _, n in crowd.sent], prepend=0).tolist()
    found = survey([path])
    assert list(found.devices) == crowd.names
    for device in found.devices.values():
        (boot,) = device.boots.values()
        assert boot.samples > 10
        assert boot.missing == 0
        # The recording may end between a batch and its corrected rates.
        assert boot.samples - boot.corrected["GOOD"] in {0, *steps}
        assert device.info is not None
    assert f"recorded in {path}" in run.said.getvalue()
    assert "3 devices" in run.said.getvalue()


@needed
def test_finished_recordings_are_copied_to_the_bucket(tmp_path: Path) -> None:
    (folder := tmp_path / "rec").mkdir()
    run = Run(folder, wait_s=10.0)
    with MemoryBus(run.broker) as bus, Crowd(bus, 1) as crowd, Server(tmp_path) as server:
        eventually(lambda: bool(crowd.sent))
        assert run.record(0.5, Bucket(server.settings(), WARD)) == 0
        (path,) = folder.iterdir()
        assert server.names() == [f"{WARD}/recordings/{path.name}"]
        assert (server.objects / server.names()[0]).read_bytes() == path.read_bytes()
        server.keys.write_text(server.keys.read_text().replace("= secret", "= wrong"))
        assert run.record(1.5, Bucket(server.settings(), WARD)) == 1
    assert "NOT COPIED: Bucket ward cannot be used: SignatureDoesNotMatch" in run.said.getvalue()


def test_nothing_is_not_recorded(tmp_path: Path) -> None:
    run = Run(tmp_path)
    with pytest.raises(RecordingError) as refused:
        run.record(1.0)
    for words in ("no device was heard within 0.3 s", "truerate/@v1/ward/**", NOWHERE[0], "start its bridge"):
        assert words in str(refused.value)
    assert not list(tmp_path.iterdir())


def test_no_router_is_said_after_a_while(tmp_path: Path) -> None:
    run = Run(tmp_path, wait_s=1.1)
    tries = []

    def refuse(endpoints: Sequence[str]) -> MemoryBus:
        tries.append(endpoints)
        raise BusError("no router at tcp/127.0.0.1:1")

    with pytest.raises(BusError, match=r"no router at .*; searched for 1 s"):
        record(WARD, NOWHERE, run.settings, Console(file=run.said), open_bus=refuse)
    assert len(tries) > 1


def test_where_it_cannot_write_it_does_not_begin(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(RecordingError, match=r"the folder does not exist; make it: mkdir -p"):
        Run(tmp_path / "none").record(1.0)
    with pytest.raises(RecordingError, match="a file, but a folder is needed"):
        Run(tmp_path / "file").record(1.0)
    with pytest.raises(RecordingError, match=r"no permission to write|read-only|cannot be written"):
        _on_a_disk_that_refuses(tmp_path)
    run = Run(tmp_path, keep_free_mb=1e9, wait_s=10.0)
    with (
        MemoryBus(run.broker) as bus,
        Crowd(bus, 1),
        pytest.raises(RecordingError, match=r"recording cannot begin: the disk is nearly full: .* MB are free"),
    ):
        run.record(1.0)


def _on_a_disk_that_refuses(tmp_path: Path) -> None:
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    if not os.access(folder, os.W_OK):
        Run(folder).record(1.0)
    run = Run(Path("/proc/self"), wait_s=10.0)  # root may write anywhere but here
    with MemoryBus(run.broker) as bus, Crowd(bus, 1):
        run.record(1.0)


@pytest.mark.parametrize(
    ("text", "value"), [("90s", 90), ("10min", 600), ("1.5 h", 5400), ("2d", 172_800), ("never", float("inf"))]
)
def test_times_wear_their_unit(text: str, value: float) -> None:
    assert seconds(text, "rotate") == value


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('rotate = "10"', "rotate is '10': give a time such as 90s, 10min or 1h, or never"),
        ('rotate = "5s"', "rotate is '5s': use 10s or more, or never"),
        ("rotate_mb = 0", "rotate_mb is 0: use 1 to 1000000"),
        ("keep_free_mb = -1", "keep_free_mb is -1"),
        ("wait_s = 0", "wait_s is 0"),
        ('folder = ""', "folder is empty"),
        ('devices = ["Chest"]', "a device in devices 'Chest' is not valid"),
        ('rotat = "1h"', "unknown key 'rotat'; did you mean 'rotate'?"),
    ],
)
def test_the_wards_file_may_say_how_and_is_checked(tmp_path: Path, table: str, said: str) -> None:
    file = tmp_path / "w.toml"
    file.write_text(f'ward = "w"\n[recorder]\n{table}\n')
    with pytest.raises(ConfigError) as refused:
        load(file, Root)
    assert f"{file}: [recorder]: {said}" in str(refused.value)
    file.write_text('ward = "w"\n[recorder]\nrotate = "10min"\n')
    assert load(file, Root).recorder == Recorder(rotate="10min")
