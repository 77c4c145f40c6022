"""Passwords against their argon2 hashes: the only file with argon2."""

from collections.abc import Sequence
from functools import cache

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from estimator.config.dashboard import Person

MIN_LENGTH = 10
_HASHER = PasswordHasher()


def hashed(password: str) -> str:
    """What is written into the ward's file; ValueError when the password is too short to be one."""
    if len(password) < MIN_LENGTH:
        raise ValueError(f"a password of {len(password)} characters; {MIN_LENGTH} are the least")
    return _HASHER.hash(password)


@cache
def _nobody() -> str:
    """Nobody's: whoever is unknown takes as long to be refused as who is known."""
    return _HASHER.hash("nobody's password")


class Passwords:
    """Those of a ward. Checking one takes tens of milliseconds of a core, and is for a thread of its own."""

    def __init__(self, people: Sequence[Person]) -> None:
        self._hashes = {person.name: person.password for person in people}

    def right(self, name: str, password: str) -> bool:
        """Whether it is this person's."""
        try:
            _HASHER.verify(self._hashes.get(name) or _nobody(), password)
        except (VerificationError, InvalidHashError):
            return False
        return name in self._hashes
