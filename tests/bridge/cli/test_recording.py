"""The verbs as people use them: what they print, what they say of bad files, and their exit codes."""

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from bridge.bus.contract import Message
from bridge.sim.calibration_session import Session, simulate_session
from bridge.wire import codec, keys
from bridge.wire.messages import Calibration, Verdict
from estimator.calibration.result import PARAMETERS
from estimator.cli.main import main
from estimator.offline.calibration_file import load
from tests.bridge.recording.crowd import WARD, info, samples
from tests.bridge.recording.test_contents import NOW, S, about, marked, recorded, run
from tests.sentences import free

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    part = [about("one"), *run("one", 0, 200), *run("one", 230, 400), *marked(), *run("two", 0, 50)]
    (made,) = recorded(tmp_path, part)
    return made


def test_info_in_words_and_as_json(path: Path, capsys: Capture) -> None:
    assert main(["recording", "info", str(path)]) == 0
    said = capsys.readouterr().out
    for words in (
        "ward ward: 2 devices",
        "30 in 1",
        "note by anna: sat up",
        "calibration accepted (closure): three turns",
    ):
        assert words in said
    assert main(["recording", "info", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["devices"]["one"]["boots"][0]["missing"] == 30
    assert found["devices"]["one"]["notes"] == [{"time_ns": NOW + 3 * S, "who": "anna", "text": "sat up"}]


def test_info_leaves_out_boots_of_which_only_old_corrected_rates_were_cached(tmp_path: Path, capsys: Capture) -> None:
    cached = [message for message in run("one", 0, 50, boot=3) if "/corrected/" in message.key]
    (path,) = recorded(tmp_path, [*cached, *run("one", 0, 200)])
    assert main(["recording", "info", str(path), "--json"]) == 0
    assert [boot["samples"] for boot in json.loads(capsys.readouterr().out)["devices"]["one"]["boots"]] == [200]
    (only,) = recorded(tmp_path, cached)
    assert main(["recording", "info", str(only)]) == 0
    assert "00000000" in capsys.readouterr().out, "a recording of corrected rates alone shows its boots"


def test_a_wrong_option_is_wrong_usage(path: Path, tmp_path: Path) -> None:
    for arguments in (
        ["inspect", str(path), "--gyro-unit", "furlong"],
        ["convert", str(path), str(tmp_path / "session.wav")],
        ["convert", str(path), str(tmp_path / "session.npz"), "--driver", "none"],
        ["export", str(path), "--bids", str(tmp_path / "dataset"), "--subject", "0 1"],
    ):
        assert main(["recording", *arguments]) == 2, arguments


def test_a_torn_file_is_told_recovered_and_then_whole(path: Path, capsys: Capture) -> None:
    torn = path.with_name(path.name + ".part")
    torn.write_bytes(path.read_bytes()[:20_000])
    path.unlink()
    assert main(["recording", "info", str(torn)]) == 1
    assert "make a complete file with truerate recording recover" in " ".join(capsys.readouterr().out.split())
    assert main(["recording", "export", str(torn), "--csv", str(torn.parent / "csv")]) == 1
    capsys.readouterr()
    assert main(["recording", "recover", str(torn)]) == 0
    assert "torn record" in capsys.readouterr().out
    assert main(["recording", "info", str(path)]) == 0


def sent(session: Session, first: int = 0) -> list[Message]:
    """A session as a ward sends it, from a sample on."""
    n = len(session.gyro)
    assert session.accel is not None
    part = [Message(keys.build(WARD, "info", bridge="b", device="one"), codec.encode_info(info("one", NOW)))]
    step = round(1e6 / session.rate_hz)
    for at in range(first, n, 20):
        rows = slice(at, min(n, at + 20))
        batch = replace(
            samples("one", at, rows.stop - at, NOW + at * step * 1000),
            ticks=np.arange(at + 1, rows.stop + 1, dtype=np.uint64) * np.uint64(step),
            gyro=session.gyro[rows].astype(np.float32),
            accel=session.accel[rows].astype(np.float32),
        )
        part.append(Message(keys.build(WARD, "raw", bridge="b", device="one"), codec.encode_samples(batch)))
    return part


def calibrated(session: Session, time_s: float, boot: int = 7, verdict: Verdict = Verdict.ACCEPTED) -> Message:
    """What an estimator said of it at a time, a little off what the session itself gives."""
    std = np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3])
    made = Calibration(
        "one", boot, f"live-{time_s:g}", NOW + round(time_s * S), "closure", verdict, free("three turns"),
        np.diag(session.truth.k + 2e-3), session.truth.turn_on_bias, PARAMETERS, np.diag(std**2), (), np.full(3, 1e-3), "m", "f",
        8.7, 400.0, 30.0, "",
    )  # fmt: skip
    return Message(keys.build(WARD, "calibration", device="one"), codec.encode_calibration(made))


def test_calibrate_and_correct_take_a_wards_recording(tmp_path: Path, capsys: Capture) -> None:
    session = simulate_session(4)
    n = len(session.gyro)
    (path,) = recorded(tmp_path, [*sent(session), *run("two", 0, 50)])
    assert main(["calibrate", str(path), "--device", "one", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert np.diag(found["matrix"]) == pytest.approx(session.truth.k, abs=5e-4)
    assert main(["correct", str(path), str(tmp_path / "out.npz"), "--device", "one"]) == 0
    with np.load(tmp_path / "out.npz") as file:
        assert len(file["t_s"]) == n
        assert (file["quality"] == 3).any()
    capsys.readouterr()
    assert main(["calibrate", str(path)]) == 1
    assert "2 devices; choose one with --device: one, two" in capsys.readouterr().err


def corrected(path: Path, capsys: Capture, *words: str) -> dict[str, Any]:
    assert main(["correct", str(path), str(path.with_suffix(".npz")), "--json", *words]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_the_calibration_that_the_boot_had_as_the_recording_began_is_used(tmp_path: Path, capsys: Capture) -> None:
    session = simulate_session(4)
    others = [calibrated(session, -5.0, boot=6), calibrated(session, -2.0, verdict=Verdict.REPEAT)]
    (path,) = recorded(tmp_path, [calibrated(session, -3.0), *others, *sent(session), calibrated(session, 9.0)])
    found = corrected(path, capsys)
    assert found["calibration"] == "live--3"
    assert (
        found["said"][0]
        == "calibration live--3 of this boot, which the recording holds, is used; not used: 1 later calibration"
    )
    assert np.diag(found["matrix"]) == pytest.approx(session.truth.k + 2e-3, abs=1e-9)
    assert "NONE" not in found["seconds_by_quality"]
    assert "PRIOR" not in found["seconds_by_quality"], "the calibration at another rate is of this boot all the same"
    other = tmp_path / "other.json"
    assert main(["calibrate", str(path), "--method", "closure", "--json"]) == 0
    other.write_text(capsys.readouterr().out)
    assert corrected(path, capsys, "--calibration", str(other))["calibration"] != "live--3", (
        "who says one gets that one"
    )


def test_one_made_meanwhile_is_used_where_its_turns_were_not_recorded(tmp_path: Path, capsys: Capture) -> None:
    session = simulate_session(4)
    end_s = session.time_s[-1]
    whole, torn = recorded(
        tmp_path, [*sent(session), calibrated(session, end_s)], [*sent(session, 1600), calibrated(session, end_s)]
    )
    assert corrected(whole, capsys)["calibration"] == f"{whole.stem}_one", "the turns themselves, from there on"
    found = corrected(torn, capsys)
    assert found["calibration"] == f"live-{end_s:g}"
    assert "without all of its turns" in found["said"][0]


def test_calibrate_shows_what_was_made_live_unless_a_method_is_named(tmp_path: Path, capsys: Capture) -> None:
    session = simulate_session(4)
    (path,) = recorded(tmp_path, [calibrated(session, -3.0), *sent(session)])
    assert main(["calibrate", str(path)]) == 0
    said = capsys.readouterr().out
    for words in (f"{session.truth.k[0] + 2e-3:.5f}", "live--3", "--method"):
        assert words in said
    kept = tmp_path / "live.json"
    assert main(["calibrate", str(path), "--json"]) == 0
    kept.write_text(capsys.readouterr().out)
    assert load(kept).id == "live--3"
    assert main(["calibrate", str(path), "--method", "closure", "--json"]) == 0
    assert np.diag(json.loads(capsys.readouterr().out)["matrix"]) == pytest.approx(session.truth.k, abs=5e-4)


COMMANDS = [
    ["recording", "info", "FILE"],
    ["recording", "info", "FILE", "--json"],
    ["recording", "recover", "FILE"],
    ["recording", "export", "FILE", "--npz", "OUT"],
    ["recording", "export", "FILE", "--csv", "OUT"],
    ["recording", "export", "FILE", "--bids", "OUT"],
    ["calibrate", "FILE"],
    ["correct", "FILE", "OUT.npz"],
    ["allan", "FILE"],
    ["bridge", "replay", "FILE"],
]


def bad_files(tmp_path: Path, good: bytes) -> dict[str, Path]:
    foreign = BytesIO()
    writer = Writer(foreign)
    writer.start()
    writer.add_message(
        writer.register_channel("/imu", "json", writer.register_schema("Imu", "jsonschema", b"{}")), 1, b"{}", 1
    )
    writer.finish()  # type: ignore[no-untyped-call]
    (tmp_path / "folder.mcap").mkdir()
    contents = {
        "empty": b"",
        "text": b"t_s,gx_dps\n",
        "beginning": good[:8],
        "header": good[:300],
        "foreign": foreign.getvalue(),
        "zeros": good[:8] + bytes(5000),
        "ones": good[:8] + b"\xff" * 5000,
    }
    files = {name: tmp_path / f"{name}.mcap" for name in (*contents, "none", "folder")}
    for name, content in contents.items():
        files[name].write_bytes(content)
    return files


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_bad_file_is_one_line_and_an_exit_code(
    path: Path, tmp_path: Path, command: list[str], capsys: Capture
) -> None:
    for name, file in bad_files(tmp_path, path.read_bytes()).items():
        words = [word.replace("FILE", str(file)).replace("OUT", str(tmp_path / "out")) for word in command]
        assert main(words) == 1, name
        said = capsys.readouterr()
        assert said.out == "", name
        (line,) = said.err.splitlines()
        assert line.startswith(f"truerate: {file}: "), name
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["record", "--rotate", "soon"], 2, "truerate: record: rotate is 'soon': give a time such as 90s"),
        (["record", "--connect", "here"], 2, "--connect"),
        (["record", "--seconds", "0"], 2, "--seconds is 0"),
        (["record", "--ward", "Ward 3"], 2, "ward 'Ward 3' is not valid"),
        (["record", "--out", "/nowhere/at/all"], 1, "the folder does not exist; make it"),
        (["record", "--config", "none.toml"], 2, "there is no such file"),
        (["bridge", "replay", "x.npz"], 1, "x.npz: there is no such file"),
        (["bridge", "replay", "/"], 1, "/: not a file"),
        (["bridge", "replay", __file__], 1, "give a recording in .npz"),
        (["bridge", "replay", __file__, "--device", "chest"], 1, "give a recording in .npz"),
        (["calibrate", "x.mcap.part"], 1, "cannot be read"),
    ],
)
def test_wrong_use_is_said(words: list[str], code: int, said: str, capsys: Capture) -> None:
    assert main(words) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_what_was_not_finished_is_to_be_made_whole_before_it_is_played(tmp_path: Path, capsys: Capture) -> None:
    (part := tmp_path / "ward.mcap.part").touch()
    assert main(["bridge", "replay", str(part)]) == 1
    assert f"complete it first: truerate recording recover {part}" in capsys.readouterr().err
