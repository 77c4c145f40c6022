"""Entry point of `python -m estimator`, which runs the command `truerate`."""

import sys

from estimator.cli.entry import main

if __name__ == "__main__":
    sys.exit(main())
