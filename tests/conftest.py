"""Fixtures for all tests."""

import os
import secrets
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings; the test is skipped, saying so, where it is absent."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the real recordings are not there ({folder})")
    return folder


class Effort:
    """How much to try: a little in `make test`, with the same seed every time; much, and something new, in `make soak`."""

    def __init__(self) -> None:
        self.long = bool(os.environ.get("TRUERATE_SOAK"))
        self.seed = secrets.randbelow(2**31) if self.long else 1

    def __call__(self, short: int, long: int) -> int:
        return long if self.long else short


@pytest.fixture
def effort() -> Effort:
    """A soak prints its seed when it fails."""
    made = Effort()
    print(f"seed {made.seed}")  # noqa: T201
    return made
