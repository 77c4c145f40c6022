"""Two estimators on one store: the second is told, and who was killed has nothing any more."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from estimator.database import StoreError
from estimator.database.owner import owned

_HAVE = """
import resource, sys
from estimator.database.owner import owned
if len(sys.argv) > 2:
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
with owned(sys.argv[1]):
    print("mine", flush=True)
    sys.stdin.read()
"""


def test_a_store_is_one_estimators_until_it_ends_however_it_ends(tmp_path: Path) -> None:
    store = str(tmp_path / "a.sqlite3")
    other = subprocess.Popen(
        [sys.executable, "-c", _HAVE, store], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdout is not None
    assert other.stdout.readline() == "mine\n"
    with (
        pytest.raises(StoreError, match="another estimator uses it: give each"),
        owned(store),
    ):
        pass
    other.send_signal(signal.SIGKILL)
    other.communicate()
    with owned(store):
        pass
    with owned(store):
        pass


def test_on_a_full_disk_it_is_had_all_the_same(tmp_path: Path) -> None:
    store = str(tmp_path / "a.sqlite3")
    other = subprocess.Popen(
        [sys.executable, "-c", _HAVE, store, "full"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdout is not None
    assert other.stdout.readline() == "mine\n"
    with pytest.raises(StoreError, match="another estimator uses it"), owned(store):
        pass
    other.communicate()
