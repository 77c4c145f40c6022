"""Verb `truerate demo`: runs a small simulated ward on this machine."""

import argparse
import secrets
from pathlib import Path

from rich.console import Console

from bridge.cli.parser import Verbs, add_verb, seed
from estimator.cli import picture_file


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `demo` to the command line."""
    verb = add_verb(verbs, "demo", _demo, "run a small simulated ward for about a minute and compare it with the truth")
    verb.add_argument(
        "--picture", type=Path, default=Path("out/demo.png"), help="file for the picture (default: %(default)s)"
    )
    verb.add_argument("--seed", type=seed, default=None, help="the same seed gives the same devices (default: random)")


def _demo(given: argparse.Namespace) -> int:
    from estimator.demo.run import run  # noqa: PLC0415

    picture_file.check("--picture", given.picture)
    chosen = secrets.randbelow(2**31) if given.seed is None else given.seed
    return 0 if run(Console(), given.picture, chosen) else 1
