"""The folder of an authority: its own pair, one pair a member, in `issuers` what signs each, and the names that were revoked.

A file is written beside, then renamed: whole or not at all. A renewal keeps the private key, so only one file changes and
a pair never is of two. Private keys are 0600 from their first byte on.
"""

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from bridge.pki.authority import DAYS, EARLIER, Pair, check_hosts, issue, new_authority, new_issuer
from bridge.pki.identity import Identity, certificates, hosts_of, lasts_of, signer
from bridge.pki.member import Member
from bridge.pki.papers import Lasts

_CA, _ISSUERS, _MEMBERS, _REVOKED = "ca", "issuers", ".members.pem", "revoked.txt"


class Folder:
    """Where `truerate pki` keeps what it makes. Every method raises ValueError, or OSError of the disk's."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def make(self, name: str, now: datetime) -> None:
        """A new authority, in a folder that has none."""
        if any((self.path / there).exists() for there in (f"{_CA}.pem", f"{_CA}.key", _ISSUERS)):
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
        check_hosts(member, hosts)  # before an issuer is made
        pair = issue(self.issuer(member), member, now - EARLIER, now + timedelta(days=days), hosts=hosts)
        _keep(self.path / member.file, pair)
        return files

    def renew(self, member: Member, now: datetime, days: int | None = None) -> Identity:
        """The same name, the same key, the same hosts, the same issuer; from now on, by default for as long as before."""
        member = self.current(member)
        files = self.identity(member)
        if missing := [path for path in (files.certificate, files.key) if not Path(path).exists()]:
            raise ValueError(
                f"{missing[0]}: is not there, and a renewal needs the certificate and its key: copy it back from the machine of"
                f" {member.label}, or make new ones: truerate pki issue {member.label}, where it had some after revoke"
            )
        own = certificates(files.certificate)[0]
        hosts, lasted = hosts_of(own), lasts_of(own)
        key = Path(files.key).read_bytes()
        if days is not None:
            ends = now + timedelta(days=days)
        elif now < (last := self.authority_lasts().ends):
            ends = min(now + (lasted.ends - lasted.begins - EARLIER), last)
        else:
            raise ValueError(f"the authority itself ends on {last:%Y-%m-%d}: make a new one, and all certificates anew")
        pair = issue(self.issuer(member), member, now - EARLIER, ends, hosts=hosts, key=key)
        _write(Path(files.certificate), pair.certificate, 0o644)
        return files

    def issuer(self, member: Member) -> Pair:
        """What signs this member's certificates, and nobody else's; made where there is none yet."""
        here = self.path / _ISSUERS / member.file
        if not Path(f"{here}.pem").exists():
            if not all((self.path / f"{_CA}.{kind}").exists() for kind in ("key", "pem")):
                raise self._none()
            pair = new_issuer(_pair(self.path / _CA), member)
            here.parent.mkdir(mode=0o700, exist_ok=True)
            _keep(here, pair)
        return _pair(here)

    def admit(self, router: Member, members: Iterable[Member]) -> None:
        """Write what a router verifies its members by: their issuers."""
        issuers = [signer(self.identity(member).certificate) for member in (router, *members)]
        _write(Path(self.gate(router).ca), b"".join(issuers), 0o644)

    def revoke(self, member: Member, now: datetime, why: str) -> Member:
        """Never use this name again: the member that was, whose common name the routers' rules must lose."""
        member = self.current(member)
        if not Path(self.identity(member).certificate).exists():
            raise ValueError(f"{self.path}: {member.label} has no certificate that could be revoked")
        lines = [*self._lines(), f"{member.common_name} {now:%Y-%m-%dT%H:%M:%SZ} {' '.join(why.split())}"]
        _write(self.path / _REVOKED, "".join(f"{line}\n" for line in lines).encode(), 0o644)
        return member

    def revoked(self) -> dict[str, str]:
        """When and why, by common name; ValueError where a line names nobody, for whoever was in it is not let in again."""
        found = dict(line.partition(" ")[::2] for line in self._lines())
        for name in found:
            try:
                Member.parse(name)
            except ValueError as error:
                raise ValueError(f"{self.path / _REVOKED}: {error}; mend that line, or bring the file back") from None
        return found

    def current(self, member: Member) -> Member:
        """The generation of a member that is not revoked."""
        revoked, generation = self.revoked(), 1
        while (now := Member(member.role, member.name, generation)).common_name in revoked:
            generation += 1
        later = self.identity(replace(now, generation=generation + 1)).certificate
        if Path(later).exists():
            raise ValueError(
                f"{self.path / _REVOKED}: {now.common_name} is not in it, and was revoked before {later} was made: bring the file"
                " back, else routers would let in again whoever was revoked"
            )
        return now

    def members(self) -> Iterator[tuple[Member, Lasts]]:
        """Everybody who has a certificate that is not revoked, and how long that lasts."""
        for path in sorted(self.path.glob("*.pem")):
            try:
                member = Member.parse(path.stem.replace(".", ":"))
            except ValueError:
                continue  # of the authority, of a router, or somebody's own
            if member == self.current(member):
                yield member, lasts_of(certificates(str(path))[0])

    def authority_lasts(self) -> Lasts:
        """How long the authority itself does."""
        if not (path := self.path / f"{_CA}.pem").exists():
            raise self._none()
        return lasts_of(certificates(str(path))[0])

    def identity(self, member: Member) -> Identity:
        """Its files, whether they are there or not."""
        here = self.path / member.file
        return Identity(str(self.path / f"{_CA}.pem"), f"{here}.pem", f"{here}.key")

    def gate(self, router: Member) -> Identity:
        """A router's files, as `identity`, but for what it verifies others by: see `admit`."""
        return replace(self.identity(router), ca=str(self.path / f"{router.file}{_MEMBERS}"))

    def _none(self) -> ValueError:
        if (self.path / _ISSUERS).exists():
            return ValueError(f"{self.path}: ca.pem or ca.key is not there: bring it here from where it is kept")
        return ValueError(
            f"{self.path}: no authority here; `truerate pki init --ward WARD --folder {self.path}` makes one"
        )

    def _lines(self) -> list[str]:
        path = self.path / _REVOKED
        try:
            text = path.read_text("utf-8-sig") if path.exists() else ""
        except UnicodeDecodeError:
            raise ValueError(f"{path} is not UTF-8 text: save the file as UTF-8 in your editor") from None
        return [line for line in text.splitlines() if line.strip()]


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
