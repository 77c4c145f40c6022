"""`truerate doctor`: in words or as JSON, and an exit code that tells trouble."""

import json
import os
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from bridge.bus.embedded_router import Router
from bridge.bus.zenoh_bus import ZenohBus
from bridge.diagnose import port_access
from bridge.diagnose.finding import trouble
from bridge.wire import keys
from bridge.wire.codec import encode_status
from estimator.cli.main import main
from estimator.demo.ward import free_port
from estimator.service.store import Store
from tests.estimator.overview.test_summary import STATUS

WARD = """ward = "w"
[bus]
connect = ["{endpoint}"]
[bridge]
id = "b"
[[bridge.devices]]
id = "gone"
driver = "native"
port = "{folder}/gone"
[estimator]
id = "e"
store = "{folder}/store/t.sqlite3"
"""


def look(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, tuple[str, str]]]:
    code = main(["doctor", "--json", *arguments])
    return code, {f["check"]: (f["level"], f["said"]) for f in json.loads(capsys.readouterr().out)}


def test_a_ward_that_is_well(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    endpoint, config = f"tcp/127.0.0.1:{free_port()}", tmp_path / "ward.toml"
    config.write_text(WARD.format(endpoint=endpoint, folder=tmp_path))
    with Router([endpoint]):
        code, found = look(capsys, str(config))
        assert code == 0
        assert main(["doctor", str(config)]) == 0
    assert found["router"] == ("ok", f"answers at {endpoint}")
    assert found["serial ports"] == ("warning", f"{tmp_path}/gone is missing")
    assert found["config"][0] == found["disk, store"][0] == "ok"
    shown = capsys.readouterr().out
    assert f"! serial ports: {tmp_path}/gone is missing\n    do: Plug the device in" in shown


def test_a_store_that_an_estimator_could_not_use_is_found_before_it_is_started(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    config, store = tmp_path / "ward.toml", tmp_path / "store" / "t.sqlite3"
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config.write_text(WARD.format(endpoint=endpoint, folder=tmp_path))
    with Router([endpoint]):  # where there is none it is looked for long
        assert "store" not in look(capsys, str(config))[1], "there is none yet"
        Store(store).close()
        assert look(capsys, str(config))[1]["store"] == ("ok", f"{store} can be read")
        with monkeypatch.context() as patch:
            patch.setattr("os.access", lambda place, mode: place != store or mode != os.W_OK)
            assert look(capsys, str(config))[1]["store"] == ("trouble", f"{store}: no permission to write it")
        whole = store.read_bytes()
        db = sqlite3.connect(store)
        db.execute("PRAGMA user_version = 99")
        db.execute("ALTER TABLE boots ADD COLUMN note TEXT")
        db.close()
        level, said = look(capsys, str(config))[1]["store"]
        assert (level, "has schema 99" in said) == ("trouble", True)
        store.write_bytes(whole[:20] + bytes(30) + whole[50:])
        level, said = look(capsys, str(config))[1]["store"]
        assert (level, "is damaged" in said) == ("trouble", True)


def test_two_bridges_with_one_device_are_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    endpoint, config = f"tcp/127.0.0.1:{free_port()}", tmp_path / "ward.toml"
    config.write_text(WARD.format(endpoint=endpoint, folder=tmp_path))
    with Router([endpoint]), ZenohBus([endpoint]) as bus:
        said = bus.publisher(keys.build("w", "status", device="a"), cache=1)
        alone = replace(STATUS, bridge="b1")
        for status, code, level in (
            (alone, 0, "ok"),
            (replace(alone, refused_bridges=("b2",)), 1, "trouble"),
        ):
            said.put(encode_status(status))
            while "bridges of the ward" not in (found := look(capsys, str(config)))[1]:
                pass  # on a busy machine half a second of listening may be too short
            assert (found[0], found[1]["bridges of the ward"][0]) == (code, level)
    assert "Samples of b2 are refused" in found[1]["bridges of the ward"][1]


def test_trouble_is_an_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tmp_path / "ward.toml"
    config.write_text('ward = "w"\nbrigde = 1\n')
    code, found = look(capsys, str(config))
    assert code == 1
    assert found["config"][0] == "trouble"
    assert "did you mean 'bridge'?" in found["config"][1]
    assert "router" not in found
    assert look(capsys)[0] == 0
    monkeypatch.setattr(port_access, "usable", lambda _: [trouble("serial ports", "[taken]", "close it")])
    assert main(["doctor"]) == 1
    assert "✗ serial ports: [taken]\n    do: close it\n" in capsys.readouterr().out
