"""The folder of an authority: its own pair, one pair a member, in `issuers` what signs each, and the names that were revoked.

A file is written beside, then renamed: whole or not at all. A renewal keeps the private key, so only one file changes and
a pair never is of two. Private keys are 0600 from their first byte on.
"""

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from bridge.pki.authority import DAYS, EARLIER, Pair, check_host, issue, new_authority, new_issuer
from bridge.pki.identity import Identity, certificates, common_name, hosts_of, signer
from bridge.pki.member import Member

_CA, _ISSUERS, _MEMBERS, _REVOKED = "ca", "issuers", ".members.pem", "revoked.txt"


class Folder:
    """Where `truerate pki` keeps what it makes. Every method raises ValueError, or OSError of the disk's."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def make(self, name: str, now: datetime) -> None:
        """A new authority, in a folder that has none."""
        if any((self.path / f"{_CA}.{kind}").exists() for kind in ("key", "pem")):
            raise ValueError(f"{self.path}: there is an authority here already; all its certificates would be void")
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        _keep(self.path / _CA, new_authority(name, now))

    def issue(self, member: Member, now: datetime, days: int = DAYS, hosts: tuple[str, ...] = ()) -> Identity:
        """A first pair for a role and a name, of the generation that is not revoked."""
        member = self.current(member)
        files = self.identity(member)
        if Path(files.certificate).exists():
            raise ValueError(
                f"{files.certificate} is there already: `truerate pki renew {member.label}` makes it last longer"
            )
        named = [check_host(host) for host in hosts]
        pair = issue(self.issuer(member), member, now - EARLIER, now + timedelta(days=days), hosts=named)
        _keep(self.path / member.file, pair)
        return files

    def renew(self, member: Member, now: datetime, days: int = DAYS) -> Identity:
        """The same name, the same key, the same hosts, the same issuer; from now on."""
        member = self.current(member)
        files = self.identity(member)
        if not Path(files.certificate).exists():
            raise ValueError(
                f"{files.certificate}: there is none to renew; `truerate pki issue {member.label}` makes one"
            )
        hosts = hosts_of(certificates(files.certificate)[0])
        key = Path(files.key).read_bytes()
        ends = now + timedelta(days=days)
        pair = issue(self.issuer(member), member, now - EARLIER, ends, hosts=hosts, key=key)
        _write(Path(files.certificate), pair.certificate, 0o644)
        return files

    def issuer(self, member: Member) -> Pair:
        """What signs this member's certificates, and nobody else's; made where there is none yet."""
        here = self.path / _ISSUERS / member.file
        if not Path(f"{here}.pem").exists():
            pair = new_issuer(self._authority(), member)
            here.parent.mkdir(mode=0o700, exist_ok=True)
            _keep(here, pair)
        return _pair(here)

    def admit(self, router: Member, members: Iterable[Member]) -> list[Member]:
        """Write what a router verifies its members by: their issuers. Those who have none, of an earlier truerate.

        That had all signed by the authority itself, by which they are then verified; and whoever was revoked, too.
        """
        issuers = {member: signer(self.identity(member).certificate) for member in (router, *members)}
        without = [member for member, issuer in issuers.items() if not issuer]
        authority = (self.path / f"{_CA}.pem").read_bytes() if without else b""
        _write(Path(self.gate(router).ca), b"".join(issuers.values()) + authority, 0o644)
        return without

    def revoke(self, member: Member, now: datetime, why: str) -> Member:
        """Never use this name again: the member that was, whose common name the routers' rules must lose."""
        member = self.current(member)
        if not Path(self.identity(member).certificate).exists():
            raise ValueError(f"{self.path}: {member.label} has no certificate that could be revoked")
        lines = [*self._lines(), f"{member.common_name} {now:%Y-%m-%dT%H:%M:%SZ} {' '.join(why.split())}"]
        _write(self.path / _REVOKED, "".join(f"{line}\n" for line in lines).encode(), 0o644)
        return member

    def revoked(self) -> dict[str, str]:
        """When and why, by common name."""
        return dict(line.partition(" ")[::2] for line in self._lines())

    def current(self, member: Member) -> Member:
        """The generation of a member that is not revoked."""
        revoked, generation = self.revoked(), 1
        while (now := Member(member.role, member.name, generation)).common_name in revoked:
            generation += 1
        return now

    def members(self) -> Iterator[tuple[Member, datetime]]:
        """Everybody who has a certificate that is not revoked, and until when."""
        revoked = self.revoked()
        for path in sorted(self.path.glob("*.pem")):
            try:
                member = Member.parse(path.stem.replace(".", ":"))
            except ValueError:
                continue  # of the authority, of a router, or somebody's own
            own = certificates(str(path))[0]
            if (name := common_name(own)) != member.common_name:
                raise ValueError(f"{path}: it is for {name!r}; a copy? Keep it in another folder")
            if member.common_name not in revoked:
                yield member, own.not_valid_after_utc

    def authority_until(self) -> datetime:
        """When the authority itself ends."""
        if not (own := self.path / f"{_CA}.pem").exists():
            raise self._none()
        return certificates(str(own))[0].not_valid_after_utc

    def identity(self, member: Member) -> Identity:
        """Its files, whether they are there or not."""
        here = self.path / member.file
        return Identity(str(self.path / f"{_CA}.pem"), f"{here}.pem", f"{here}.key")

    def gate(self, router: Member) -> Identity:
        """A router's files, as `identity`, but for what it verifies others by: see `admit`."""
        return replace(self.identity(router), ca=str(self.path / f"{router.file}{_MEMBERS}"))

    def _authority(self) -> Pair:
        if not (self.path / f"{_CA}.key").exists():
            raise self._none()
        return _pair(self.path / _CA)

    def _none(self) -> ValueError:
        return ValueError(
            f"{self.path}: no authority here; `truerate pki init --ward WARD --folder {self.path}` makes one"
        )

    def _lines(self) -> list[str]:
        path = self.path / _REVOKED
        return path.read_text("utf-8").splitlines() if path.exists() else []


def utc_now() -> datetime:
    """Now, to the second, as certificates have it."""
    return datetime.now(UTC).replace(microsecond=0)


def _pair(here: Path) -> Pair:
    return Pair(Path(f"{here}.pem").read_bytes(), Path(f"{here}.key").read_bytes())


def _keep(here: Path, pair: Pair) -> None:
    """The key first: a certificate is there with its key, or not at all."""
    _write(Path(f"{here}.key"), pair.key, 0o600)
    _write(Path(f"{here}.pem"), pair.certificate, 0o644)


def _write(path: Path, content: bytes, mode: int) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, mode), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
