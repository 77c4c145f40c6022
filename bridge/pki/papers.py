"""The files by which a program says who it is: where they are. What is in them is looked at in identity.py."""

from dataclasses import dataclass
from datetime import timedelta

#: so long before its end a certificate is to be renewed
SOON = timedelta(days=14)


@dataclass(frozen=True, slots=True)
class Identity:
    """Paths of PEM files: whose word counts (ca), who we are, and the key that proves it."""

    ca: str
    certificate: str
    key: str
