"""Programs of a ward as processes of a bench: how they are started and ended, and what they use."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from estimator.demo.ward import listens

CLI = "estimator.cli.main"
_TICK_S = 1 / os.sysconf("SC_CLK_TCK")


@contextmanager
def program(
    *words: str, log: Path = Path(os.devnull), pipe: bool = False, env: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[str]]:
    """A process of `python -m` with these words, ended with the block; pipe: its output is read here, not logged."""
    with log.open("a") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if pipe else out,
            stderr=None if pipe else out,
            text=True,
            env=os.environ | (env or {}),
        )
    with process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGCONT)
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(15)
            process.kill()


def line(process: subprocess.Popen[str]) -> str:
    """The next line that a process says, by a pipe."""
    assert process.stdout is not None
    return process.stdout.readline()


def ward_file(folder: Path, ward: str, endpoint: str, more: str = "") -> Path:
    """The file of a ward with one router and an estimator `e`; more: further tables."""
    file = folder / "ward.toml"
    file.write_text(
        f'ward = "{ward}"\n[bus]\nconnect = ["{endpoint}"]\n[router]\nlisten = ["{endpoint}"]\n'
        f'[estimator]\nid = "e"\nstore = "{folder}/store.sqlite3"\n{more}'
    )
    return file


@contextmanager
def router(file: Path, endpoint: str) -> Iterator[subprocess.Popen[str]]:
    """The router of a ward's file, once it listens."""
    with program(CLI, "router", "--config", str(file), log=file.with_name("router.log")) as process:
        if not listens(endpoint, 20.0):
            raise RuntimeError("the router does not listen")
        yield process


@contextmanager
def estimator(file: Path, env: Mapping[str, str] | None = None) -> Iterator[subprocess.Popen[str]]:
    """The estimator of a ward's file, once it serves; it logs to estimator.log beside the file."""
    log = file.with_name("estimator.log")
    with program(CLI, "estimator", "serve", str(file), log=log, env=env) as process:
        until = time.monotonic() + 60.0
        while "serves ward" not in log.read_text():
            if time.monotonic() > until or process.poll() is not None:
                raise RuntimeError(f"the estimator does not serve: {log.read_text()[-2000:]}")
            time.sleep(0.05)
        yield process


def cpu_s(pid: int) -> float:
    """Processor time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * _TICK_S


def rss_mb(pid: int) -> float:
    """Resident memory of a process."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
