"""Bytes chosen by the coverage they reach, with atheris: `python -m tests.fuzz.guided native 10000000`."""

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["bridge"]):
    from tests.fuzz.executions import Target


def main(name: str, runs: int) -> None:
    """Ends the process; what raises is printed with its input, which is kept as a file crash-..."""
    target = Target(name)
    with tempfile.TemporaryDirectory() as corpus:
        for i, seed in enumerate(target.seeds):
            (Path(corpus) / str(i)).write_bytes(seed)
        options = [f"-atheris_runs={runs}", "-max_len=256", "-verbosity=0", "-print_final_stats=1"]
        atheris.Setup(["fuzz", *options, corpus], target.feed)
        atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
