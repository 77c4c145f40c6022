"""What truerate writes is not readable by other users of the machine; what is so already is found; a hang-up is a stop."""

import contextlib
import os
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from estimator.cli.main import main
from estimator.demo.ward import free_port

PEOPLE = '[[dashboard.people]]\nname = "nurse"\npassword = "$argon2id$v=19$m=64,t=1,p=1$c29tZXNhbHQ$AAAA"\n'


def ward(folder: Path) -> Path:
    """A ward's file; it has a password hash."""
    file = folder / "ward.toml"
    file.write_text(
        f'ward = "w"\n[bus]\nconnect = ["tcp/127.0.0.1:{free_port()}"]\n[estimator]\nid = "e"\n'
        f'store = "{folder}/kept/t.sqlite3"\n{PEOPLE}'
    )
    return file


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_nothing_that_is_written_is_readable_by_others_and_a_hang_up_ends_it_in_order(
    tmp_path: Path, umask: int
) -> None:
    command = [sys.executable, "-m", "estimator.cli.main", "estimator", "serve", str(ward(tmp_path))]
    with subprocess.Popen(command, umask=umask, stderr=subprocess.DEVNULL) as serving, contextlib.ExitStack() as stack:
        stack.callback(serving.kill)
        _check(tmp_path, serving)


def _check(tmp_path: Path, serving: "subprocess.Popen[bytes]") -> None:
    store, until = tmp_path / "kept" / "t.sqlite3", time.monotonic() + 60
    while not store.with_name("t.sqlite3-wal").exists():
        assert time.monotonic() < until
        assert serving.poll() is None
        time.sleep(0.05)
    written = {path: stat.S_IMODE(path.stat().st_mode) for path in (store.parent, *store.parent.iterdir())}
    assert len(written) >= 4
    assert {path.name: oct(mode) for path, mode in written.items() if mode & 0o027} == {}
    serving.send_signal(signal.SIGHUP)
    assert serving.wait(60) == 0


@pytest.fixture
def entered() -> Iterator[Path]:
    """A folder that others may enter, which pytest's own is not."""
    with tempfile.TemporaryDirectory() as made:
        Path(made).chmod(0o755)
        yield Path(made)


def test_what_others_can_read_is_said(entered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = ward(entered)
    file.chmod(0o644)
    assert main(["config", "check", str(file)]) == 0
    said = f"{file}: every user of this machine can read {file}: chmod o-rwx {entered}, or the files in it\n"
    assert said in capsys.readouterr().out
    (entered / "kept").mkdir(mode=0o755)
    (entered / "kept").chmod(0o755)
    (entered / "kept" / "t.sqlite3").touch()
    (entered / "kept" / "t.sqlite3").chmod(0o644)
    assert main(["config", "check", str(file)]) == 0
    assert f"can read {file} and 1 more" in capsys.readouterr().out
    (urls := entered / "urls").touch()
    urls.chmod(0o644)
    file.write_text(f'{file.read_text()}[alerts]\nurls_file = "{urls}"\n')
    assert main(["config", "check", str(file)]) == 0
    assert f"can read {urls} and 2 more" in capsys.readouterr().out
    urls.chmod(0o600)
    file.chmod(0o640)
    (entered / "kept").chmod(0o750)
    assert main(["config", "check", str(file)]) == 0
    assert "every user" not in capsys.readouterr().out


def test_under_nohup_a_hang_up_is_ignored() -> None:
    program = (
        "import signal; from bridge.runtime.signals import asked_by; print(signal.SIGHUP in asked_by());"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN); print(signal.SIGHUP in asked_by())"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    told = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["True", "False"]
