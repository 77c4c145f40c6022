"""`truerate history`, `store backup`, `store check` and `store restore`, as people use them."""

import json
import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from bridge.reasons.codes import Code
from bridge.toml.loader import load
from estimator.cli import doctor
from estimator.cli.main import main
from estimator.config.dashboard import Person
from estimator.config.people_file import empty, people_in, put, remove
from estimator.config.schema import Ward
from estimator.database import owned
from estimator.service.history import read, since
from estimator.service.serve import copied
from estimator.service.store import Store
from estimator.service.store_reader import StoreReader
from estimator.web.passwords import hashed
from tests.bridge.bucket.server import Server, needed
from tests.estimator.database.kept import CALIBRATIONS, fill, loaded
from tests.estimator.stream import NAME
from tests.sentences import free

NOW = datetime(2026, 3, 8, 12, 0, tzinfo=UTC)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """As an estimator that is running has it: much is in the log only."""
    opened = Store(tmp_path / "a.sqlite3")
    fill(opened)
    opened.add_audit(7, NAME, "calibrate", "c9", "nurse", "repeat", free("the turn about y is missing"), accepted=False)
    yield opened
    opened.close()


def history(store: Store, *words: str) -> int:
    return main(["history", NAME, "--store", store.path, *words])


def test_history_in_tables(store: Store, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert history(store) == 0
    said = capsys.readouterr().out
    for words in (
        "0.9000±0.0020",
        "accepted (turn360)",
        "power up",
        "m 1.0",
        "recalibrate",
        "strap",
        "nothing to cancel",
    ):
        assert words in said, words
    assert said.count("0.9000±") == len(CALIBRATIONS)
    assert said.count("repeat: the turn about y is missing") == 1


def test_history_as_json(store: Store, capsys: pytest.CaptureFixture[str]) -> None:
    assert history(store, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [c["id"] for c in found["calibrations"]] == ["c1", "c2", "c3"]
    assert np.array(found["calibrations"][0]["covariance"]).shape == (6, 6)
    assert [boot["boot"][-1] for boot in found["boots"]] == ["1", "2", "3"]
    assert [command["verb"] for command in found["commands"]] == ["recalibrate", "cancel", "calibrate"]
    assert [len(boot["bias_rad_s"]) for boot in found["bias"]] == [6, 6, 6]
    assert found["bias"][1]["bias_rad_s"][0] == pytest.approx([0.2, -0.4, 0.6])
    assert found["bias"][1]["temperature_c"][0] == 22.0


def test_history_from_a_time_on(store: Store) -> None:
    found = read(store, NAME, since_ns=20)
    assert (len(found.calibrations), len(found.boots), len(found.commands)) == (0, 0, 0)
    assert [of.boot[-1] for of in found.biases] == ["2", "3"]


def test_history_draws(store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "new" / "a.png"
    assert history(store, "--plot", str(picture)) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert str(picture) in capsys.readouterr().out
    assert history(store, "--plot", str(tmp_path / "a.txt")) == 2


def test_history_of_nothing_says_what_there_is(
    store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["history", "wrist", "--store", store.path]) == 1
    assert f"the store has {NAME}" in capsys.readouterr().err
    assert main(["history", NAME, "--store", str(tmp_path / "none")]) == 1
    assert "no such file; name the ward file with --config" in capsys.readouterr().err
    assert main(["store", "check", str(tmp_path / "none")]) == 1
    assert "no such file; name the ward file with --config" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
    assert history(store, "--since", "2300-01-01") == 1
    assert f"has no entries of {NAME} since 2300-01-01" in capsys.readouterr().err
    assert history(store, "--since", "yesterday") == 2
    assert "2026-03-01" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "when"),
    [
        ("7d", "2026-03-01T12:00:00+00:00"),
        ("1.5h", "2026-03-08T10:30:00+00:00"),
        ("2026-03-01", "2026-03-01T00:00:00+01:00"),
        ("2026-07-01", "2026-07-01T00:00:00+02:00"),
        ("2026-03-01T14:30+02:00", "2026-03-01T14:30:00+02:00"),
    ],
)
def test_since(text: str, when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as there:
        there.setenv("TZ", "Europe/Berlin")
        time.tzset()
        assert since(text, NOW).isoformat() == when
    time.tzset()


@pytest.mark.parametrize("text", ["", "7", "d", "-1d", "2026-13-01", "99999999999w"])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"invalid time|too long"):
        since(text, NOW)


def test_a_backup_of_a_store_in_use_has_everything(
    store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, folder = loaded(store), tmp_path / "backups"
    folder.mkdir()
    assert main(["store", "backup", str(folder), "--store", store.path]) == 0
    (copy,) = folder.iterdir()
    assert str(copy) in capsys.readouterr().out
    again = StoreReader.reading(copy)
    assert loaded(again) == kept
    again.close()
    assert main(["store", "backup", str(copy), "--store", store.path]) == 1
    assert "already" in capsys.readouterr().err
    for where in (f"{tmp_path / 'stick'}/copy", f"{tmp_path / 'stick'}/"):
        assert main(["store", "backup", where, "--store", store.path]) == 2
        assert f"there is no folder {tmp_path / 'stick'}; make it with mkdir -p" in capsys.readouterr().err


def test_a_backup_of_an_empty_store_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = Store(tmp_path / "a.sqlite3")
    store.database.back_up_if_due()
    assert not list((tmp_path / "backups").iterdir()), "nor does the estimator make one"
    assert main(["store", "backup", str(tmp_path / "copy"), "--store", store.path]) == 1
    assert "has no entries, so there is nothing to back up: check the path of the store" in capsys.readouterr().err
    assert not (tmp_path / "copy").exists()
    fill(store)
    store.database.back_up_if_due()
    assert len(list((tmp_path / "backups").iterdir())) == 1
    store.close()


def test_the_newest_backups_in_a_folder_are_kept(
    store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder := tmp_path / "stick").mkdir()
    names = ["a-20260101T000000.sqlite3", "a-20260102T000000.sqlite3", "a.sqlite3", "ab-20260101T000000.sqlite3"]
    for name in names:
        (folder / name).touch()
    assert main(["store", "backup", str(folder), "--keep", "2", "--store", store.path]) == 0
    assert f"removed {folder / names[0]}: the newest 2 backups are kept" in capsys.readouterr().out
    left = sorted(one.name for one in folder.iterdir())
    assert len(left) == 4
    assert set(names[1:]) < set(left), "a file of another name is never removed"
    for words in ([str(folder), "--keep", "0"], [str(tmp_path / "one"), "--keep", "2"]):
        assert main(["store", "backup", *words, "--store", store.path]) == 2


def test_verify_tries_a_restore(store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["store", "verify", "--store", store.path]) == 1
    assert "there is no backup of store" in capsys.readouterr().err
    store.database.back_up_if_due()
    (backup,) = (tmp_path / "backups").iterdir()
    before = backup.read_bytes()
    assert main(["store", "verify", "--store", store.path]) == 0
    assert f"{backup} (0 h old) can be restored: 1 device, 3 calibrations" in capsys.readouterr().out
    assert backup.read_bytes() == before
    backup.write_bytes(before.replace(b"nothing to cancel", b"Nothing to cancel", 1))
    assert main(["store", "verify", "--store", store.path]) == 1
    assert "is damaged" in capsys.readouterr().err


def test_a_store_in_use_is_restored_with_its_newest_entries(
    store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["store", "verify", store.path]) == 0
    assert "can be restored: 1 device, 3 calibrations" in capsys.readouterr().out
    assert main(["store", "restore", store.path, "--store", str(tmp_path / "other.sqlite3")]) == 0
    assert "3 calibrations" in capsys.readouterr().out


@pytest.mark.parametrize("running", [True, False])
def test_check_says_whether_it_is_sound(store: Store, capsys: pytest.CaptureFixture[str], *, running: bool) -> None:
    path = Path(store.path)
    store.database.back_up_if_due()
    if not running:
        store.close()
    before = path.read_bytes()
    assert main(["store", "check", "--store", str(path)]) == 0
    said = capsys.readouterr().out
    assert "is undamaged: 3 calibrations" in said
    assert "18 bias history points" in said
    assert f"backup {path.parent / 'backups' / 'a-00001.sqlite3'} of " in said
    assert path.read_bytes() == before
    if not running:
        assert sorted(one.name for one in path.parent.iterdir()) == ["a.sqlite3", "backups"], (
            "looking leaves nothing behind"
        )
        path.write_bytes(before.replace(b"nothing to cancel", b"Nothing to cancel", 1))
        assert main(["store", "check", "--store", str(path)]) == 1
        said = capsys.readouterr().out
        assert "is damaged: row 2 missing from index audit_all" in said
        assert "`truerate store restore`" in said
        assert main(["store", "check", str(path), "--json"]) == 1
        found = json.loads(capsys.readouterr().out)
        assert (found["sound"], found["fault"] != "") == (False, True)
        assert main(["store", "backup", str(path.with_name("copy")), "--store", str(path)]) == 1
        assert "is damaged" in capsys.readouterr().err
        assert not path.with_name("copy").exists()


def test_restore_puts_a_backup_in_its_place(store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept, path = loaded(store), Path(store.path)
    assert main(["store", "restore", "--store", str(path)]) == 1
    assert "no undamaged backup" in capsys.readouterr().err
    store.database.back_up_if_due()
    with owned(str(path)):
        assert main(["store", "restore", "--store", str(path)]) == 1
        assert "another estimator" in capsys.readouterr().err
    store.add_audit(8, NAME, "note", "later", "nurse", "", (Code.NOTED(),), accepted=True)
    store.close()
    now = path.read_bytes()
    assert main(["store", "restore", "--store", str(path)]) == 0
    said = capsys.readouterr().out
    (aside,) = tmp_path.glob("a.sqlite3.aside-*")
    assert f" as {path}: 3 calibrations" in said
    assert str(aside) in said
    assert aside.read_bytes() == now
    again = Store(path)
    assert loaded(again) == kept
    assert again.answer(NAME, "note", "later") is None
    again.close()
    assert main(["store", "restore", str(aside), "--store", str(path)]) == 0
    again = Store(path)
    assert again.answer(NAME, "note", "later") is not None
    again.close()
    torn = tmp_path / "torn.sqlite3"
    torn.write_bytes(now[:9000])
    assert main(["store", "restore", str(torn), "--store", str(path)]) == 1
    assert "no undamaged backup" in capsys.readouterr().err


def test_a_restored_ward_has_its_people(store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder := tmp_path / "backups").mkdir()
    people, config = tmp_path / "people.toml", tmp_path / "ward.toml"
    config.write_text(
        f'ward = "w"\n[estimator]\nid = "e1"\nstore = "{store.path}"\n[dashboard]\npeople_file = "{people}"\n'
    )
    for name in ("nurse", "chief"):
        put(people, "w", Person(name=name, role="operator", password=hashed("a long password")))
    kept = people_in(people)
    assert main(["store", "backup", str(folder), "--config", str(config)]) == 0
    assert (folder / "w-people.toml").stat().st_mode & 0o777 == 0o600, "password hashes"
    store.database.back_up_if_due()
    store.close()
    remove(people, "chief")
    assert main(["store", "restore", "--config", str(config)]) == 0
    assert [one.name for one in people_in(people)] == ["nurse"], "whoever was removed stays removed"
    people.write_text(empty("w"))
    assert main(["store", "restore", "--config", str(config)]) == 0
    assert people_in(people) == kept
    assert f"restored {folder / 'w-people.toml'} as {people}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "verb", [["store", "check"], ["history", NAME], ["store", "backup", "copy.sqlite3"]], ids=" ".join
)
def test_what_is_empty_or_no_store_is_said_with_what_to_do(
    tmp_path: Path, verb: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "a.bin"
    noise = np.random.default_rng(1).bytes(20_000)
    for content, words in (
        *([(b"", ("the file is empty", "backup"))] if verb != ["store", "check"] else []),
        *((noise[:n], ("is not a truerate store", "--config")) for n in (1, 100, 1000, 4096, 20_000)),
    ):
        file.write_bytes(content)
        assert main([*verb, "--store", str(file)]) == 1
        said = capsys.readouterr()
        assert said.out == ""
        (line,) = said.err.splitlines()
        for word in (str(file), *words):
            assert word in line, len(content)
    assert not (tmp_path / "copy.sqlite3").exists()


@needed
def test_a_backup_in_the_bucket_is_tried_restored_and_found_by_doctor(
    store: Store, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with Server(tmp_path) as server:
        (config := tmp_path / "ward.toml").write_text(
            f'ward = "w"\n[estimator]\nid = "e1"\nstore = "{store.path}"\n'
            f'[s3]\nendpoint = "http://127.0.0.1:{server.port}"\nbucket = "ward"\ncredentials_file = "{server.keys}"\n'
        )
        verify = ["store", "verify", "--s3", "--config", str(config)]
        assert main(verify) == 1
        assert f"there is no backup of store {store.path} in the bucket" in capsys.readouterr().err
        store.database.back_up_if_due()
        mirror = copied(load(config, Ward))
        assert mirror is not None
        mirror.close()
        assert mirror.fault is None
        (name,) = server.names()
        assert re.fullmatch(r"w/backups/e1/a-00001-\d{8}T\d{6}Z\.sqlite3", name)
        assert main(verify) == 0
        assert "of the bucket (0 h old) can be restored: 1 device, 3 calibrations" in capsys.readouterr().out
        found = {one.check: one for one in doctor._bucket(load(config, Ward))}
        assert "ward answers: newest backup of " in found["bucket"].said
        kept = loaded(store)
        store.close()
        Path(store.path).unlink()
        assert main(["store", "restore", Path(name).name, "--s3", "--config", str(config)]) == 0
        assert f"restored {Path(name).name} of the bucket as {store.path}: 3 calibrations" in capsys.readouterr().out
        again = Store(store.path)
        assert loaded(again) == kept
        again.close()
        server.keys.write_text(server.keys.read_text().replace("= secret", "= wrong"))
        assert main(verify) == 1
        assert "Bucket ward cannot be used: SignatureDoesNotMatch" in capsys.readouterr().err
    assert main(["store", "verify", "--s3", "--store", store.path]) == 2
