"""Paths of a certificate's files, and its validity period; certificate_checks.py checks the content."""

from dataclasses import dataclass
from datetime import datetime, timedelta

_SOON = timedelta(days=14)


@dataclass(frozen=True, slots=True)
class Validity:
    """Validity period of a certificate, in UTC."""

    begins: datetime
    ends: datetime

    @property
    def soon(self) -> datetime:
        """Time from which to renew: 14 days before the end, or the last third of a short validity."""
        return self.ends - min(_SOON, (self.ends - self.begins) / 3)


@dataclass(frozen=True, slots=True)
class Identity:
    """Paths of PEM files: the trusted authorities, the certificate, and its private key."""

    ca: str
    certificate: str
    key: str
