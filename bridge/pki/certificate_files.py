"""Where the files of a certificate are, and how long it is valid; certificate_checks.py checks their content."""

from dataclasses import dataclass
from datetime import datetime, timedelta

_SOON = timedelta(days=14)


@dataclass(frozen=True, slots=True)
class Validity:
    """From when until when a certificate is valid."""

    begins: datetime
    ends: datetime

    @property
    def soon(self) -> datetime:
        """From when on it is to be renewed: two weeks before its end; one that was made for few weeks, in its last third."""
        return self.ends - min(_SOON, (self.ends - self.begins) / 3)


@dataclass(frozen=True, slots=True)
class Identity:
    """Paths of PEM files: the trusted authorities, the certificate, and its private key."""

    ca: str
    certificate: str
    key: str
