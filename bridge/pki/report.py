"""Who has a certificate, in what role, and for how long: rows for people, and whether somebody has to act. Pure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime

from bridge.pki.identity import SOON
from bridge.pki.member import Member

AUTHORITY = "authority"


@dataclass(frozen=True, slots=True)
class Row:
    """One certificate as it is now; trouble is empty where nobody has to act."""

    who: str
    role: str
    until: datetime
    days: int
    trouble: str


def rows(members: Iterable[tuple[Member, datetime]], authority_until: datetime, now: datetime) -> Iterator[Row]:
    """The authority first."""
    yield _row("", AUTHORITY, authority_until, now, "make a new one, and with it all certificates anew")
    for member, until in members:
        yield _row(member.name, member.role.value, until, now, f"truerate pki renew {member.label}")


def _row(who: str, role: str, until: datetime, now: datetime, remedy: str) -> Row:
    days = (until - now).days
    if until < now:
        trouble = f"expired: {remedy}"
    elif until - now < SOON:
        trouble = f"expires soon: {remedy}"
    else:
        trouble = ""
    return Row(who, role, until, days, trouble)
