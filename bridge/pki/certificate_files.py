"""Paths of a program's certificate files, and validity periods. `certificate_checks` checks the content of the files."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from bridge.pki.member import Member

_SOON = timedelta(days=14)


@dataclass(frozen=True, slots=True)
class Validity:
    """Validity period of a certificate. begins, ends: datetimes in UTC."""

    begins: datetime
    ends: datetime

    @property
    def soon(self) -> datetime:
        """Time from which the certificate should be renewed, a datetime in UTC.

        14 days before the end of the validity period, or a third of the period before its end if this is later.
        """
        return self.ends - min(_SOON, (self.ends - self.begins) / 3)


@dataclass(frozen=True, slots=True)
class Identity:
    """Paths of a program's PEM files: trusted authorities (ca), certificate, and private key."""

    ca: str
    certificate: str
    key: str


def identities_in(folder: Path) -> dict[Member, Identity]:
    """Find the certificates `ROLE.NAME.pem` in a machine's folder; return the paths of their files by member.

    Of a member with several certificates, only that of the highest generation is returned. The files are not read.
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
