"""`truerate recording inspect` and `convert`: what is understood is shown; what is written is read back the same."""

import json
from pathlib import Path

import numpy as np
import pytest

from bridge.recording import load
from estimator.cli.main import main
from tests.bridge.recording.text.session import right, table, turns

TIME, GYRO, ACCEL = turns()


@pytest.fixture
def session(tmp_path: Path) -> Path:
    path = tmp_path / "session.csv"
    rows = table([TIME, GYRO, ACCEL])
    path.write_text("\n".join(["t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g", *rows[:420], *rows[430:]]))
    return path


@pytest.mark.parametrize("ending", ["npz", "csv", "mcap"])
def test_a_recording_is_written_and_read_back(session: Path, ending: str) -> None:
    out = session.with_name(f"out.{ending}")
    assert main(["recording", "convert", str(session), str(out), "--device", "chest"]) == 0
    before, after = load(session), load(out)
    assert np.allclose(after.time_s, before.time_s, atol=1e-6)
    assert np.allclose(after.gyro, before.gyro, atol=1e-6)
    assert before.accel is not None
    assert after.accel is not None
    assert np.allclose(after.accel, before.accel, atol=1e-5)
    assert (after.sequence == before.sequence).all()
    right(out)


def test_nothing_is_overwritten_and_an_ending_must_be_known(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recording", "convert", str(session), str(session)]) == 1
    assert "is not overwritten" in capsys.readouterr().err
    assert main(["recording", "convert", str(session), str(session.with_suffix(".wav"))]) == 2
    assert "use .npz, .csv, .h5, .parquet, .mcap" in capsys.readouterr().err


def test_a_driver_that_decodes_no_bytes_is_named(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(session.with_name("out.npz"))
    assert main(["recording", "convert", str(session), out, "--driver", "witmotoin"]) == 2
    assert "did you mean 'witmotion'?" in capsys.readouterr().err
    assert main(["recording", "convert", str(session), out, "--driver", "witmotion"]) == 1
    assert "no sample found by witmotion" in capsys.readouterr().err


def test_inspect_says_what_is_in_a_file(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recording", "inspect", str(session)]) == 0
    said = capsys.readouterr().out
    assert "rate:        50 Hz" in said
    assert "gaps:        1, 10 samples missing, the first of 10 at 8.380 s" in said
    assert main(["recording", "inspect", str(session), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["samples"] == len(TIME) - 10
    assert found["gravity"] == pytest.approx(9.81, abs=0.05)
    assert found["gaps"] == [{"after_s": pytest.approx(8.38), "missing": 10}]
