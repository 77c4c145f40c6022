"""Machine code that is kept for the next start, cannot be kept, or is damaged."""

import ast
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
#: as `python -m estimator.loops`, which `make setup` runs, of two loops: all of them take a minute
_MADE = """
from estimator.loops import compiled, cut, rest
compiled._load = lambda: None
folder = compiled.kept()
compiled.ready()
print("kept in", folder)
"""
_BEYOND = """
import numpy as np
from estimator.loops.rest import calm
try:
    calm(np.zeros((3, 1, 3)), 5, np.zeros(3), np.zeros(3), 0.0, 1.0)
except IndexError as error:
    print(error)
"""


def start(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    told = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    return subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=told, capture_output=True, text=True, timeout=280, check=False
    )


def test_what_is_compiled_is_kept_and_what_is_damaged_is_said_and_made_anew(tmp_path: Path) -> None:
    first = start(tmp_path, "-c", _MADE)
    assert first.returncode == 0, first.stderr
    assert f"kept in {tmp_path}" in first.stdout
    kept = sorted(tmp_path.rglob("*.nb?"))
    assert kept
    dated = [path.stat().st_mtime_ns for path in kept]
    again = start(tmp_path, "-c", _MADE)
    assert again.returncode == 0, again.stderr
    assert [path.stat().st_mtime_ns for path in kept] == dated
    for part in ("rest.calm*.nbi", "cut.*.nbc"):  # an index and a code
        (path,) = tmp_path.rglob(part)
        path.write_bytes(path.read_bytes()[:500])
    damaged = start(tmp_path, "-c", _MADE)
    assert damaged.returncode == 0, damaged.stderr
    assert damaged.stderr.count("is compiled anew: what was kept of it is damaged") == 2
    mended = start(tmp_path, "-c", _MADE)
    assert (mended.returncode, mended.stderr) == (0, "")
    beyond = start(tmp_path, "-c", _BEYOND)  # what was kept fails as what is compiled does
    assert (beyond.returncode, beyond.stdout) == (0, "index is out of bounds\n"), beyond.stderr
    (code,) = tmp_path.rglob("rest.calm*.nbc")
    code.write_bytes(code.read_bytes()[:4096] + bytes(4096) + code.read_bytes()[8192:])
    emptied = start(tmp_path, "-c", _MADE)
    assert emptied.returncode == 0, emptied.stderr
    assert "calm is compiled anew: what was kept of it is damaged" in emptied.stderr


def test_where_nothing_can_be_kept_it_is_said(tmp_path: Path) -> None:
    nowhere = "from numba.core import caching; caching.CacheImpl._locator_classes = []"
    run = "import runpy; runpy.run_module('estimator.loops', run_name='__main__')"
    found = start(tmp_path, "-c", f"{nowhere}; {run}")
    assert found.returncode == 1
    assert "NUMBA_CACHE_DIR" in found.stderr


def test_what_is_kept_is_that_of_its_own_file() -> None:
    """Numba compiles a constant in, and looks for changes in the file of the loop alone."""
    folder = ROOT / "estimator" / "loops"
    found = {
        node.module
        for file in folder.glob("[!_]*.py")
        if file.name != "compiled.py"
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in ("bridge", "estimator")
    }
    assert found == {"estimator.loops.compiled"}


def test_who_starts_does_not_wait_for_a_part_of_scipy_that_no_loop_needs_and_it_is_there_later() -> None:
    code = (
        "import sys; from estimator.service import serve; serve._load(); "
        "assert 'scipy.linalg' not in sys.modules; "
        "import numpy, scipy.linalg.cython_blas; scipy.linalg.lu_factor(numpy.eye(3))"
    )
    said = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=280, check=False
    )
    assert said.returncode == 0, said.stderr
