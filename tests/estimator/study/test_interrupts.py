"""Ctrl-C in a study: it ends, and says nothing of its workers."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.nemesis.field import ignores


@pytest.mark.parametrize("study", ["protocols"])
def test_workers_that_are_interrupted_print_no_traceback(study: str, tmp_path: Path) -> None:
    run = "import sys; from estimator.cli.entry import main; sys.exit(main())"
    words = [sys.executable, "-c", run, "study", study, "--runs", "20000", "--workers", "2"]
    with subprocess.Popen(
        words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        deadline = time.monotonic() + 60
        while sum("spawn_main" in _command(child) for child in children.read_text().split()) < 2 or ignores(
            process.pid, signal.SIGINT
        ):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in said


def _command(child: str) -> str:
    try:
        return Path(f"/proc/{child}/cmdline").read_text()
    except OSError:
        return ""
