"""Ten million executions of every decoder: damaged messages, and a tenth of them guided by coverage, where atheris is there."""

import argparse
import importlib.util
import subprocess
import sys

from tests.fuzz.executions import names

RUNS = 10_000_000
#: one in so many is guided by coverage, which takes ten times as long
GUIDED = 10


def main() -> int:
    """Exit code 1 as soon as a decoder raises."""
    parser = argparse.ArgumentParser(description=__doc__, epilog="Example: python -m tests.fuzz native --runs 1e6")
    parser.add_argument("names", nargs="*", metavar="DRIVER", help="which (default: all)")
    parser.add_argument(
        "--runs", type=lambda text: int(float(text)), default=RUNS, help="executions of each (default 1e7)"
    )
    args = parser.parse_args()
    guided = args.runs // GUIDED if importlib.util.find_spec("atheris") else 0
    for name in args.names or names():
        for kind, runs in (("blind", args.runs - guided), ("guided", guided)):
            if not runs:
                continue
            command = [sys.executable, "-m", f"tests.fuzz.{kind}", name, str(runs)]
            if subprocess.run(command, check=False).returncode:
                print(f"{name}: failed; the input is above", file=sys.stderr)
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
