"""The verbs as people use them: what they print, what they say of bad files, and their exit codes."""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from bridge.bus.contract import Message
from bridge.sim.session import simulate_session
from bridge.wire import codec, keys
from estimator.cli import main
from tests.bridge.record.crowd import WARD, info, samples
from tests.bridge.record.test_contents import NOW, S, about, marked, recorded, run

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


def test_a_torn_file_is_told_recovered_and_then_whole(path: Path, capsys: Capture) -> None:
    torn = path.with_name(path.name + ".part")
    torn.write_bytes(path.read_bytes()[:40_000])
    path.unlink()
    assert main(["recording", "info", str(torn)]) == 1
    assert "recording recover makes a whole file of it" in " ".join(capsys.readouterr().out.split())
    assert main(["recording", "recover", str(torn)]) == 0
    assert "torn record" in capsys.readouterr().out
    assert main(["recording", "info", str(path)]) == 0


def test_export_of_one_device(path: Path, tmp_path: Path, capsys: Capture) -> None:
    assert main(["recording", "export", str(path), "--csv", str(tmp_path / "out"), "--device", "two"]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "out" / name) for name in ("two.csv", "events.csv")]
    assert main(["recording", "export", str(path), "--npz", str(tmp_path / "out"), "--device", "three"]) == 1
    assert "no samples of 'three'; there are of one, two" in capsys.readouterr().err


def test_calibrate_and_correct_take_a_wards_recording(tmp_path: Path, capsys: Capture) -> None:
    session = simulate_session(4)
    n = len(session.gyro)
    assert session.accel is not None
    part = [Message(keys.build(WARD, "info", bridge="b", device="one"), codec.encode_info(info("one", NOW)))]
    from dataclasses import replace

    step = round(1e6 / session.rate_hz)
    for at in range(0, n, 20):
        rows = slice(at, min(n, at + 20))
        batch = replace(
            samples("one", at, rows.stop - at, NOW + at * step * 1000),
            ticks=np.arange(at + 1, rows.stop + 1, dtype=np.uint64) * np.uint64(step),
            gyro=session.gyro[rows].astype(np.float32),
            accel=session.accel[rows].astype(np.float32),
        )
        part.append(Message(keys.build(WARD, "raw", bridge="b", device="one"), codec.encode_samples(batch)))
    (path,) = recorded(tmp_path, [*part, *run("two", 0, 50)])
    assert main(["calibrate", str(path), "--device", "one", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert np.diag(found["matrix"]) == pytest.approx(session.truth.k, abs=5e-4)
    assert main(["correct", str(path), str(tmp_path / "out.npz"), "--device", "one"]) == 0
    with np.load(tmp_path / "out.npz") as file:
        assert len(file["t_s"]) == n
        assert (file["quality"] == 3).any()
    capsys.readouterr()
    assert main(["calibrate", str(path)]) == 1
    assert "it has 2 devices; choose one by --device: one, two" in capsys.readouterr().err


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


@pytest.mark.parametrize("command", COMMANDS[:6], ids=" ".join)
@pytest.mark.parametrize("part", [0.3, 0.7, 0.97])
def test_a_torn_or_flipped_file_gives_what_it_has(
    path: Path, tmp_path: Path, command: list[str], part: float, capsys: Capture
) -> None:
    data = path.read_bytes()
    flipped = bytearray(data)
    flipped[int(part * len(data))] ^= 0x55
    for number, content in enumerate((data[: int(part * len(data))], bytes(flipped))):
        file = tmp_path / f"bad{number}.mcap"
        file.write_bytes(content)
        out = str(tmp_path / f"out{number}")
        code = main([word.replace("FILE", str(file)).replace("OUT", out) for word in command])
        said = capsys.readouterr()
        assert code in (0, 1)
        assert said.out or said.err.startswith("truerate: ")
        assert "Traceback" not in said.err


def test_help_has_the_verbs_in_the_order_of_use(capsys: Capture) -> None:
    with pytest.raises(SystemExit):
        main(["recording", "--help"])
    said = capsys.readouterr().out
    places = [said.index(f"\n    {verb} ") for verb in ("info", "export", "recover")]
    assert places == sorted(places)
    assert "truerate bridge replay" in said


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["record", "--rotate", "soon"], 2, "truerate: record: rotate is 'soon'; a time such as 90s"),
        (["record", "--connect", "here"], 2, "--connect"),
        (["record", "--seconds", "0"], 2, "--seconds is 0"),
        (["record", "--ward", "Ward 3"], 2, "ward 'Ward 3' is not valid"),
        (["record", "--out", "/nowhere/at/all"], 1, "there is no such folder; make it first"),
        (["record", "--config", "none.toml"], 2, "there is no such file"),
        (["bridge", "replay", "x.npz"], 1, "x.npz: there is no such file"),
        (["bridge", "replay", "/"], 1, "/: not a file"),
        (["bridge", "replay", __file__], 2, "does not say which device it is of: say it with --device ID"),
        (["calibrate", "x.mcap.part"], 1, "cannot be read"),
    ],
)
def test_wrong_use_is_said(words: list[str], code: int, said: str, capsys: Capture) -> None:
    assert main(words) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
