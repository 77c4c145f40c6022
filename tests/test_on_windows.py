"""What works on Windows, tested in a Python that lacks what Windows lacks (`as_on_windows.py`): analysis and the client."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ANALYSIS = [
    "tests/estimator/offline",
    *(f"tests/estimator/cli/test_{verb}.py" for verb in ("allan", "calibrate", "correct")),
    *(f"tests/bridge/recording/{name}" for name in ("test_convert.py", "test_export.py", "formats")),
    "tests/estimator/study/test_runner.py",
    "tests/estimator/client/test_client.py",
]
#: processes that are started are no longer as on Windows; and pictures are slow
NOT = "not missing_package and not workers and not picture"
PLAIN = [
    "-o",
    "addopts=",
    "-q",
    "-p",
    "tests.as_on_windows",
    "--capture=sys",
    "-p",
    "no:randomly",
    "-p",
    "no:cacheprovider",
]


def _python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.timeout(600)
def test_analysis_and_client_pass_their_tests() -> None:
    ran = _python("-m", "pytest", *PLAIN, "-k", NOT, *ANALYSIS)
    assert ran.returncode == 0, ran.stdout[-4000:] + ran.stderr[-2000:]
    assert " passed" in ran.stdout


def test_a_service_says_in_one_sentence_that_it_does_not_run_there() -> None:
    program = (
        "import tests.as_on_windows; from estimator.cli.main import main; "
        "print([main(words.split()) for words in ('router', 'estimator serve ward.toml', 'bridge run ward.toml', 'dashboard')])"
    )
    ran = _python("-c", program)
    assert ran.stdout.strip() == "[2, 2, 2, 2]"
    assert ran.stderr.count("does not run on Windows") == ran.stderr.count("\n") == 4
