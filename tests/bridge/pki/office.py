"""The command, as whoever keeps the authority gives it."""

from datetime import timedelta
from pathlib import Path

from bridge.pki.member import Member
from estimator.cli.main import main

DAY = timedelta(days=1)


B1 = Member.parse("bridge:b1")


def run(pki: Path, *arguments: str) -> int:
    return main(["pki", *arguments, "--folder", str(pki)])
