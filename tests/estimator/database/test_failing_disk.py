"""Whichever change of the disk fails, once or from then on: the session goes on, says so, loses nothing, and catches up."""

import errno
import json
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from tests.conftest import Effort

HERE = Path(__file__).parent
ERRORS = (errno.EIO, errno.ENOSPC, errno.EROFS)
ALWAYS = 10**6


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("there is no C compiler here, or no Linux, to make the calls of the kernel fail")
    made = tmp_path_factory.mktemp("shim") / "failing_disk.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", made, HERE / "failing_disk.c", "-ldl"], check=True)
    return made


def sessions(shim: Path, folder: Path, tried: list[tuple[int, int, int]]) -> list[dict[str, int]]:
    """What came of a session without failures, and of one for each that was tried."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.estimator.database.failing_disk", shim, folder],
        input="\n".join(" ".join(map(str, one)) for one in tried),
        capture_output=True,
        text=True,
        check=False,
        env={"LD_PRELOAD": str(shim), "PYTHONPATH": str(HERE.parents[2])},
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == 1 + len(tried)
    return found


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_whichever_change_of_the_disk_fails_the_session_goes_on(shim: Path, tmp_path: Path, effort: Effort) -> None:
    smooth, *_ = sessions(shim, tmp_path, [])
    changes = smooth["changes"]
    assert changes > 30
    assert smooth["troubled"] == smooth["store failed"] == 0
    numbers = range(1, changes + 1) if effort.long else (1, 4, changes // 2)
    modes = list(product(numbers, (1, ALWAYS), ERRORS))
    if not effort.long:
        modes = modes[:: len(ERRORS) + 1]
    shutil.rmtree(tmp_path)
    tmp_path.mkdir()
    for found in sessions(shim, tmp_path, modes)[1:]:
        wrong = [what for what, so in found.items() if so is False]
        assert wrong == [], found
        assert found["sessions failed"] == 0
        # One that SQLite could do without, or that passed within a second, need not be seen; a disk that stays so is.
        assert found["unready"] <= found["troubled"] + 1, found
        if found["tried"][1] == ALWAYS:  # type: ignore[index]
            assert found["troubled"] > 0, found
            assert found["store failed"] > 0, found
            assert found["unready"] > 0, found
