"""Where the system gives no more memory or threads, one line says so."""

import pytest

from estimator.cli import main


@pytest.mark.parametrize(
    ("error", "words"), [(MemoryError(), "ulimit -v"), (RuntimeError("can't start new thread"), "ulimit -u")]
)
def test_what_a_limit_forbids_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception, words: str
) -> None:
    def refused(_: object) -> int:
        raise error

    monkeypatch.setattr("bridge.cli.router.router", refused)
    assert main.main(["router", "--listen", "tcp/127.0.0.1:1"]) == 1
    printed = capsys.readouterr().err
    assert words in printed
    assert printed.count("\n") == 1
