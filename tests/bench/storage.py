"""Thirty days of a ward's storage by an accelerated clock, and what compression gives on a real recording. `make bench-storage`.

The recorder, the store and its care are the real ones; only their clock is simulated. Each hour brings a new recording,
entries in the store, and a look at the disk. Each day the newest backup is restored. Figures: largest size of the
recordings; greatest age of the newest backup, which must be restorable; files that vanished and were not named in the log.
"""

import argparse
import contextlib
import io
import json
import logging
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np
from mcap.reader import make_reader
from rich.console import Console

from bridge.bus.contract import Message
from bridge.recording import load
from bridge.recording.files import Folder
from bridge.recording.recorder import WardRecorder
from bridge.recording.settings import Recorder
from bridge.wire import codec, keys
from bridge.wire.messages import SampleBatch
from estimator.cli.main import main as truerate
from estimator.database import Backups, Database
from estimator.service.store import Store
from estimator.service.store_care import StoreCare
from estimator.service.store_writer import StoreWriter
from tests.sentences import free

HOUR_S, DAYS, KEEP_DAYS, KEEP_BYTES = 3600, 30, 20.0, 12e6
BEGIN_S = 1_790_000_000
#: recordings of real devices; absent ones are left out
REAL = Path(__file__).parents[3] / "shared/data"
NAMES = (
    "xio_fusion/sensor_data",
    "broad/21_undisturbed_fast_combined",
    "sunsided_mpu6050/unmoved-x-pointing-forward",
    "imucal/ferraris_session",
)
_WARD, _BATCH_S = "w", 0.05


class Said(logging.Handler):
    """Everything that was logged."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.words = list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        self.words.append(record.getMessage())


def month(folder: Path) -> dict[str, float]:
    """Run thirty days; returns the figures."""
    said, recordings = Said(), folder / "recordings"
    logging.getLogger().addHandler(said)
    logging.getLogger().setLevel(logging.INFO)
    recordings.mkdir()
    settings = Recorder(rotate="1h", rotate_mb=5.0, keep_free_mb=0.0, keep_days=KEEP_DAYS, keep_gb=KEEP_BYTES / 1e9)
    recorder = WardRecorder(Folder(recordings, _WARD), _WARD, settings)
    database = Database(folder / "a.sqlite3")
    store, backups = Store(database), Backups.of(folder / "a.sqlite3")
    clock = [BEGIN_S]
    clerk = StoreWriter(database, thread=False)
    care = StoreCare(store, lambda: clock[0] * 10**9, clerk)
    most, oldest_s, known, vanished, restored = 0, 0.0, set[Path](), set[Path](), 0
    recorder.begin(clock[0] * 10**9, 0.0)
    with mock.patch("estimator.database.database.time.time", side_effect=lambda: clock[0]):
        for hour in range(DAYS * 24):
            clock[0] = BEGIN_S + hour * HOUR_S
            now_s = float(hour * HOUR_S)
            recorder.take(_messages(hour), clock[0] * 10**9, now_s)
            for later_s in (0, 60):  # a look for expired files follows each new file within a minute
                recorder.tick((clock[0] + later_s) * 10**9, now_s + later_s)
            store.add_audit(clock[0] * 10**9, "chest", "note", f"r{hour}", "nurse", "", free("an hour"), accepted=True)
            care.tend(now_s, 1)
            there = {path for path in (*recordings.iterdir(), *backups.newest_first()) if path.suffix != ".part"}
            for path in there - known:
                os.utime(path, (clock[0], clock[0]))  # the system's clock is the real one
            vanished |= known - there
            known |= there
            most = max(most, sum(path.stat().st_size for path in recordings.iterdir()))
            newest = backups.newest_first()
            oldest_s = max(oldest_s, clock[0] - newest[0].stat().st_mtime if newest else now_s)
            if hour % 24 == 23:
                with contextlib.redirect_stdout(io.StringIO()):
                    restored += truerate(["store", "verify", "--store", str(folder / "a.sqlite3")]) == 0
    recorder.close()
    store.close()
    logging.getLogger().removeHandler(said)
    unsaid = [path for path in vanished if not any(str(path) in words for words in said.words)]
    return {
        "recordings_mb": most / 1e6,
        "backup_age_h": oldest_s / 3600,
        "restored": restored,
        "vanished": len(vanished),
        "unsaid": len(unsaid),
        "deleted_recordings": recorder.account.expired,
        "backups": len(newest),
    }


def compression(folder: Path) -> Iterator[tuple[str, float, float, float]]:
    """Record readings of real devices; yields file name, kB of samples without compression, kB of file, and bytes a sample."""
    for source in (path for name in NAMES if (path := REAL / f"{name}.npz").is_file()):
        recording = load(source)
        out = folder / source.stem
        out.mkdir()
        recorder = WardRecorder(Folder(out, _WARD), _WARD, Recorder(keep_free_mb=0.0))
        recorder.begin(BEGIN_S * 10**9, 0.0)
        step = max(1, round(recording.rate_hz * _BATCH_S))
        for at in range(0, len(recording.time_s), step):
            cut = slice(at, at + step)
            time_ns = BEGIN_S * 10**9 + round(at / recording.rate_hz * 1e9)
            ticks = np.round(recording.time_s[cut] * 1e6).astype(np.int64)
            accel = None if recording.accel is None else recording.accel[cut]
            message = _message(at, time_ns, ticks, recording.gyro[cut], accel)
            recorder.take([message], time_ns, at / recording.rate_hz)
            recorder.tick(time_ns, at / recording.rate_hz)
        recorder.close()
        (path,) = out.iterdir()
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        plain = sum(chunk.uncompressed_size for chunk in summary.chunk_indexes)
        size = path.stat().st_size
        yield f"{source.parent.name}/{source.stem}", plain / 1e3, size / 1e3, size / len(recording.time_s)


def _messages(hour: int) -> list[Message]:
    """A few messages of an hour: noise, which does not compress."""
    rng = np.random.default_rng(hour)
    return [
        _message(
            n * 10, (BEGIN_S + hour * HOUR_S) * 10**9, np.arange(10) + n * 10, rng.normal(0.0, 0.01, (10, 3)), None
        )
        for n in range(200)
    ]


def _message(sequence: int, time_ns: int, ticks: np.ndarray, gyro: np.ndarray, accel: np.ndarray | None) -> Message:
    batch = SampleBatch(
        device="chest",
        boot=1,
        sequence=sequence,
        receive_time_ns=time_ns,
        start_time_ns=BEGIN_S * 10**9,
        tick_period_s=1e-6,
        clock_rate=1.0,
        ticks=ticks.astype(np.uint64),
        gyro=gyro.astype(np.float32),
        accel=None if accel is None else accel.astype(np.float32),
        temperature_c=None,
        flags=np.zeros(len(ticks), np.uint32),
    )
    return Message(keys.build(_WARD, "raw", bridge="b1", device="chest"), codec.encode_samples(batch))


def main(words: list[str]) -> int:
    """Print the figures; 1 if one misses its goal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(words)
    console = Console()
    with tempfile.TemporaryDirectory() as folder:
        found = month(Path(folder))
    with tempfile.TemporaryDirectory() as folder:
        sizes = list(compression(Path(folder)))
    console.print(f"{DAYS} days: recordings at most {found['recordings_mb']:.1f} MB (goal {KEEP_BYTES / 1e6:g})")
    console.print(
        f"newest backup at most {found['backup_age_h']:.0f} h old (goal 24); {found['restored']} of {DAYS} restores succeeded"
    )
    console.print(
        f"{found['vanished']} files vanished, {found['deleted_recordings']} of them recordings; {found['unsaid']} not named"
        " in the log (goal 0)"
    )
    for name, plain_kb, size_kb, each in sizes:
        console.print(
            f"{name}: {plain_kb:.0f} kB in {size_kb:.0f} kB: {plain_kb / size_kb:.2f} times, {each:.1f} bytes a sample"
        )
    if given.json:
        print(json.dumps(found))
    reached = found["recordings_mb"] <= KEEP_BYTES / 1e6 and found["backup_age_h"] <= 24
    return 0 if reached and not found["unsaid"] and found["restored"] == DAYS else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
