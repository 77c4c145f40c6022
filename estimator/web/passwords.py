"""Password check against argon2 hashes. Only this file uses argon2."""

from collections.abc import Sequence
from functools import cache

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from estimator.config.dashboard import Person

MIN_LENGTH = 10
_HASHER = PasswordHasher()


def hashed(password: str) -> str:
    """Return the argon2 hash of a password, for the ward file.

    Raises ValueError if the password has fewer than MIN_LENGTH characters.
    """
    if len(password) < MIN_LENGTH:
        raise ValueError(f"the password has {len(password)} characters: use at least {MIN_LENGTH}")
    return _HASHER.hash(password)


@cache
def _nobody() -> str:
    """Hash for unknown names, so that refusing an unknown name takes as long as refusing a known one."""
    return _HASHER.hash("nobody's password")


class Passwords:
    """Passwords of a ward's people, as hashes.

    A check takes tens of milliseconds of processor time: run it on a thread.
    """

    def __init__(self, people: Sequence[Person]) -> None:
        self._hashes = {person.name: person.password for person in people}

    def right(self, name: str, password: str) -> bool:
        """Return whether the password belongs to the person of this name; an unknown name takes as long to check."""
        try:
            _HASHER.verify(self._hashes.get(name) or _nobody(), password)
        except (VerificationError, InvalidHashError):
            return False
        return name in self._hashes
