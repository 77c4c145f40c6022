"""Disks that are full, read-only or failing: a patient store goes on with what it can read, and comes back."""

import errno
import os
import resource
import shutil
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from bridge.wire.refusal import Tally
from estimator.database import Change, Unavailable, inspect
from estimator.database.database import RETRY_S
from estimator.service.record import Record
from estimator.service.store import Store, StoreError
from estimator.session import DeviceSession
from tests.conftest import Effort
from tests.estimator.database.kept import CALIBRATIONS, fill, loaded, made
from tests.estimator.stream import NAME, info


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process can be written: the kernel's own refusal, EFBIG."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextmanager
def no_more_files() -> Iterator[None]:
    """No file can be opened: EMFILE."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = max(map(int, os.listdir("/proc/self/fd")))  # noqa: PTH208
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(used, before[1]), before[1]))
    filler = []
    try:
        while True:
            try:
                filler.append(os.dup(0))
            except OSError:
                break
        yield
    finally:
        for one in filler:
            os.close(one)
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def patient(path: Path) -> tuple[Store, list[float]]:
    clock = [0.0]
    store = Store(path, patient=True)
    store.database._clock = lambda: clock[0]
    store.database._again_s = RETRY_S if store.database.trouble else store.database._again_s
    return store, clock


def test_what_has_no_number_where_one_must_be_is_not_passed_over_in_silence(tmp_path: Path) -> None:
    store = Store(tmp_path / "a.sqlite3")
    nowhere = replace(info(7), gyro_range=float("nan"))
    with pytest.raises(Unavailable, match="NOT NULL"):
        store.add_boot(nowhere, 7)
    store.add_boot(info(7), 7)
    store.add_boot(info(7), 8)  # the same again
    assert [row["time_ns"] for row in store.database.rows("boots")] == [7]
    store.close()


def test_a_disk_that_fills_up_and_is_emptied_again(tmp_path: Path) -> None:
    store, clock = patient(tmp_path / "a.sqlite3")
    fill(store)
    kept = loaded(store)
    with full_disk():
        with pytest.raises(Unavailable, match="disk"):
            store.add_boot(info(7), 7)
        assert store.database.trouble
        assert loaded(store) == kept, "it can still be read"
        with pytest.raises(Unavailable):
            store.database.probe()
    clock[0] += RETRY_S
    store.database.probe()
    assert store.database.trouble == ""
    store.add_boot(info(7), 7)
    assert loaded(store) == kept
    store.close()
    assert inspect(tmp_path / "a.sqlite3").sound


@pytest.mark.parametrize("trouble", [full_disk, no_more_files])
def test_it_starts_in_trouble_and_recovers(tmp_path: Path, trouble: Callable[[], AbstractContextManager[None]]) -> None:
    path = made(tmp_path)
    whole = Store(path)
    kept = loaded(whole)
    whole.close()
    with trouble():
        store, clock = patient(path)
        assert store.database.trouble
        with pytest.raises(StoreError):
            store.add_boot(info(7), 7)
        if trouble is full_disk:
            assert loaded(store) == kept, "what is there is used"
    clock[0] += RETRY_S
    store.add_boot(info(7), 7)
    assert store.database.trouble == ""
    assert loaded(store) == kept
    store.close()


def test_a_folder_that_cannot_be_written_is_read(tmp_path: Path) -> None:
    """With the log that a killed estimator left there: as another user, for root may write everywhere."""
    path = tmp_path / "a.sqlite3"
    store = Store(path)
    fill(store)
    kept = loaded(store)
    copy = tmp_path / "ro" / "a.sqlite3"
    copy.parent.mkdir()
    for tail in ("", "-wal"):
        copy.with_name(copy.name + tail).write_bytes(path.with_name(path.name + tail).read_bytes())
    store.close()
    os.chmod(copy.parent, 0o555)  # noqa: PTH101
    try:
        if os.access(copy.parent, os.W_OK):
            copy.with_name(copy.name + "-shm").mkdir()  # what SQLite wants to write beside it cannot be
        reader = Store.reading(copy)
        assert loaded(reader) == kept
        with pytest.raises(StoreError):
            reader.add_boot(info(7), 7)
        reader.close()
    finally:
        os.chmod(copy.parent, 0o755)  # noqa: PTH101


def test_what_is_written_together_is_there_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    store, _ = patient(tmp_path / "a.sqlite3")
    whole = {"device": NAME, "boot": "b", "time_ns": 1, "state": "s"}
    with pytest.raises(KeyError):
        store.database.write(Change("bias", whole), Change("bias", {"no such column": 1}))
    with pytest.raises(Unavailable, match="NOT NULL"):
        store.database.write(Change("bias", whole), Change("bias", {"device": NAME}, "ABORT"))
    assert store.database.rows("bias") == []
    store.add_calibration(CALIBRATIONS[0])
    store.close()


WRITER = """
import sys
from dataclasses import replace
from estimator.service.store import Store
from tests.estimator.database.kept import CALIBRATIONS, bias
store = Store(sys.argv[1])
number = int(sys.argv[2])
while True:
    number += 1
    store.add_calibration(replace(CALIBRATIONS[0], id=f"k{number}", boot=number, time_ns=number))
    store.save_bias("chest", number, number, bias(number), history=True)
    print(number, flush=True)
"""


FAILED = """
import sys
from dataclasses import replace
from estimator.service.store import Store, StoreError
from tests.estimator.database.kept import CALIBRATIONS, bias
store = Store(sys.argv[1], patient=True)
for number in range(4, 12):
    try:
        store.add_calibration(replace(CALIBRATIONS[0], id=f"k{number}", boot=number, time_ns=number))
        print(number, flush=True)
        store.save_bias("chest", number, number, bias(number), history=True)
    except StoreError:
        store.database._again_s = 0.0  # no need to wait
store.close()
"""


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not here to make calls of the kernel fail")
def test_whichever_call_of_the_kernel_fails_nothing_that_was_acknowledged_is_lost(
    tmp_path: Path, effort: Effort
) -> None:
    tried = [("fdatasync", "EIO", 7)]
    if effort.long:
        tried = list(product(["pwrite64", "fdatasync", "openat"], ["EIO", "ENOSPC"], range(1, 80)))
    for call, error, n in tried:
        folder = tmp_path / f"{call}-{error}-{n}"
        folder.mkdir()
        path = made(folder)
        inject = ["strace", "-f", "-qq", "-o", str(folder / "trace"), "-e", f"trace={call}"]
        inject += ["-e", f"inject={call}:error={error}:when={n}"]
        done = subprocess.run(
            [*inject, sys.executable, "-c", FAILED, str(path)], capture_output=True, text=True, check=False, timeout=100
        )
        assert done.returncode == 0, done.stderr
        numbers = {int(line) for line in done.stdout.splitlines()} | {1, 2, 3}
        assert "INJECTED" in (folder / "trace").read_text() or effort.long
        store = Store(path)
        assert numbers <= {c.boot for c in store.calibrations(NAME)}
        store.close()
        assert inspect(path).sound


@pytest.mark.soak
def test_killed_while_saving_nothing_that_was_acknowledged_is_lost(tmp_path: Path, effort: Effort) -> None:
    path, said = tmp_path / "a.sqlite3", 0
    for kill in range(effort(2, 1000)):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path), str(1000 * kill)], stdout=subprocess.PIPE, text=True
        )
        assert writer.stdout is not None
        lines: list[str] = []
        enough = 20 + 7 * (kill % 9)
        killer = threading.Timer(60.0, writer.kill)
        killer.start()
        for line in writer.stdout:
            lines.append(line)
            if len(lines) == enough:
                writer.kill()  # whatever it is doing
        killer.cancel()
        writer.wait()
        writer.stdout.close()
        assert len(lines) >= enough
        numbers = {int(line) for line in lines if line.endswith("\n")}
        said += len(numbers)
        store = Store(path)
        found = {c.boot for c in store.calibrations(NAME)}
        assert numbers <= found
        remembered = [store.recall(NAME, number, 0) for number in sorted(numbers)]
        assert all(one is not None and one.bias is not None for one in remembered)
        store.close()
        assert inspect(path).sound
    assert said >= 40


def test_a_failing_disk_is_told_once_and_so_is_its_recovery(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    store, clock = patient(tmp_path / "a.sqlite3")
    counts, session = Tally(), DeviceSession(NAME)
    record = Record(store, counts, lambda: 1)
    with full_disk():
        for n in range(5):
            record.boot(session, info(n))
        record.tend(0.0)
        record.tend(1.0)
    assert caplog.text.count("goes on from memory") == 1
    assert session.status(0).events["store failed"] == counts.as_dict()["store failed"] == 5
    clock[0] += RETRY_S
    record.tend(clock[0] + 1.0)
    assert record.trouble == ""
    assert caplog.text.count("works again") == 1
    record.boot(session, info(9))
    assert caplog.text.count("works again") == 1
    with full_disk():
        record.boot(session, info(10))
    assert caplog.text.count("goes on from memory") == 2, "another outage is news"
    store.close()


def test_where_a_folder_cannot_be_synchronised_a_store_is_put_right_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path)
    path.write_bytes(path.read_bytes()[:-5000])
    whole = os.fsync

    def synced(handle: int) -> None:
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        whole(handle)

    monkeypatch.setattr("estimator.database.rescue.os.fsync", synced)
    store = Store(path)
    assert "what is whole in it goes on" in store.database.notes[0]
    store.close()


def test_the_service_counts_what_was_damaged(tmp_path: Path) -> None:
    path = made(tmp_path)
    path.write_bytes(path.read_bytes()[:-5000])
    store, _ = patient(path)
    counts = Tally()
    Record(store, counts, lambda: 1).tend(0.0)
    assert counts.as_dict() == {"damage in the store": 1}
    store.close()
