"""Who has a certificate, in what role, and for how long: rows for people, and whether somebody has to act. Pure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime

from bridge.pki.member import Member
from bridge.pki.papers import Lasts

AUTHORITY = "authority"


@dataclass(frozen=True, slots=True)
class Row:
    """One certificate as it is now; trouble is empty where nobody has to act."""

    who: str
    role: str
    until: datetime
    days: int
    trouble: str


def rows(members: Iterable[tuple[Member, Lasts]], authority: Lasts, now: datetime) -> Iterator[Row]:
    """The authority first."""
    yield _row("", AUTHORITY, authority, now, "make a new one, and with it all certificates anew")
    for member, lasts in members:
        yield _row(member.name, member.role.value, lasts, now, f"truerate pki renew {member.label}")


def _row(who: str, role: str, lasts: Lasts, now: datetime, remedy: str) -> Row:
    days = (lasts.ends - now).days
    if lasts.ends < now:
        trouble = f"expired: {remedy}"
    elif now >= lasts.soon:
        trouble = f"expires soon: {remedy}"
    else:
        trouble = ""
    return Row(who, role, lasts.ends, days, trouble)
