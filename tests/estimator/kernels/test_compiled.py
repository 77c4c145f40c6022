"""Compiled loops are cached for the next start."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
_CUT = """
import logging
logging.basicConfig(level=logging.INFO)
import numpy as np
from estimator.kernels.second_cuts import cut, nothing_gathered
state, waiting = nothing_gathered()
cut(np.zeros((0, 22)), 0, 0, waiting, state, (1.0, 0.5, 0.4))
print("called")
try:
    cut(np.ones((1, 22)), 0, 0, waiting[:0], state, (1.0, 0.5, 0.4))
except IndexError as error:
    print(error)
"""


def start(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    told = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    return subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=told, capture_output=True, text=True, timeout=300, check=False
    )


@pytest.mark.timeout(300)  # compiling takes long on a busy machine
def test_what_is_compiled_is_cached_for_the_next_start(tmp_path: Path) -> None:
    first = start(tmp_path, _CUT)
    assert first.stdout == "called\nindex is out of bounds\n", first.stderr
    assert "compiled cut" in first.stderr
    cached = sorted(tmp_path.rglob("*.nb?"))
    assert cached
    again = start(tmp_path, _CUT)
    assert (again.stdout, again.stderr) == ("called\nindex is out of bounds\n", "")
