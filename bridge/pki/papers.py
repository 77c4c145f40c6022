"""The files by which a program says who it is: where they are. What is in them is looked at in identity.py."""

from dataclasses import dataclass
from datetime import datetime, timedelta

_SOON = timedelta(days=14)


@dataclass(frozen=True, slots=True)
class Lasts:
    """From when until when a certificate is good."""

    begins: datetime
    ends: datetime

    @property
    def soon(self) -> datetime:
        """From when on it is to be renewed: two weeks before its end; one that was made for few weeks, in its last third."""
        return self.ends - min(_SOON, (self.ends - self.begins) / 3)


@dataclass(frozen=True, slots=True)
class Identity:
    """Paths of PEM files: whose word counts (ca), who we are, and the key that proves it."""

    ca: str
    certificate: str
    key: str
