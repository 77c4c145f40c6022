"""Paths of a certificate's files, and its validity period; certificate_checks.py checks the content."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from bridge.pki.member import Member

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
    """Paths of a program's PEM files: the trusted authorities, the certificate, and its private key."""

    ca: str
    certificate: str
    key: str


def identities_in(folder: Path) -> dict[Member, Identity]:
    """Find the certificates `ROLE.NAME.pem` in a machine's folder.

    Returns the paths by member, of the newest generation of each member. The content is not read.
    """
    found = dict[tuple[str, str], Member]()
    for path in folder.glob("*.*.pem"):
        try:
            member = Member.parse(path.stem.replace(".", ":"))
        except ValueError:
            continue  # a router's issuers, or a foreign file
        before = found.setdefault((member.role.value, member.name), member)
        if member.generation > before.generation:
            found[member.role.value, member.name] = member
    return {
        member: Identity(str(folder / "ca.pem"), str(folder / f"{member.file}.pem"), str(folder / f"{member.file}.key"))
        for _, member in sorted(found.items())
    }
