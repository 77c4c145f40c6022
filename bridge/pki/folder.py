"""The folder of an authority: its own pair, a pair per member, an issuer per member, and the revoked names.

A file is written beside, then renamed: whole or not at all. A renewal keeps the private key, so only one file changes and
a pair never is of two. Private keys are 0600 from their first byte on.
"""

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from bridge.pki.authority import DAYS, EARLIER, Pair, check_hosts, issue, new_authority, new_issuer
from bridge.pki.certificate_checks import Identity, certificates, hosts_of, lasts_of, signer
from bridge.pki.certificate_files import Validity
from bridge.pki.member import Member

_CA, _ISSUERS, _MEMBERS, _REVOKED = "ca", "issuers", ".members.pem", "revoked.txt"


class Folder:
    """The folder that `truerate pki` works in. Methods raise ValueError, and OSError of the disk."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def make(self, name: str, now: datetime) -> None:
        """Make an authority in a folder that has none."""
        if any((self.path / there).exists() for there in (f"{_CA}.pem", f"{_CA}.key", _ISSUERS)):
            raise ValueError(f"{self.path}: there is an authority here already; all its certificates would be void")
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        _keep(self.path / _CA, new_authority(name, now))

    def issue(self, member: Member, now: datetime, days: int = DAYS, hosts: tuple[str, ...] = ()) -> Identity:
        """Make the first pair of a member, in the generation that is not revoked."""
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
        """Make a new certificate with the same name, key, hosts and issuer, by default for as long as the one before."""
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
        """The issuer of a member, made where there is none yet."""
        here = self.path / _ISSUERS / member.file
        if not Path(f"{here}.pem").exists():
            if not all((self.path / f"{_CA}.{kind}").exists() for kind in ("key", "pem")):
                raise self._none()
            pair = new_issuer(_pair(self.path / _CA), member)
            here.parent.mkdir(mode=0o700, exist_ok=True)
            _keep(here, pair)
        return _pair(here)

    def admit(self, router: Member, members: Iterable[Member]) -> None:
        """Write the issuers of a router's members, by which it verifies them."""
        issuers = [signer(self.identity(member).certificate) for member in (router, *members)]
        _write(Path(self.gate(router).ca), b"".join(issuers), 0o644)

    def revoke(self, member: Member, now: datetime, why: str) -> Member:
        """Revoke the current generation of a member, and return it: no router's rules may name it from now on."""
        member = self.current(member)
        if not Path(self.identity(member).certificate).exists():
            raise ValueError(f"{self.path}: {member.label} has no certificate that could be revoked")
        lines = [*self._lines(), f"{member.common_name} {now:%Y-%m-%dT%H:%M:%SZ} {' '.join(why.split())}"]
        _write(self.path / _REVOKED, "".join(f"{line}\n" for line in lines).encode(), 0o644)
        return member

    def revoked(self) -> dict[str, str]:
        """When and why each common name was revoked. Raises ValueError where a line names no member."""
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

    def members(self) -> Iterator[tuple[Member, Validity]]:
        """Each member whose certificate is not revoked, and how long that certificate is valid."""
        for path in sorted(self.path.glob("*.pem")):
            try:
                member = Member.parse(path.stem.replace(".", ":"))
            except ValueError:
                continue  # of the authority, of a router, or somebody's own
            if member == self.current(member):
                yield member, lasts_of(certificates(str(path))[0])

    def authority_lasts(self) -> Validity:
        """How long the authority's certificate is valid."""
        if not (path := self.path / f"{_CA}.pem").exists():
            raise self._none()
        return lasts_of(certificates(str(path))[0])

    def identity(self, member: Member) -> Identity:
        """Paths of a member's files, whether they exist or not."""
        here = self.path / member.file
        return Identity(str(self.path / f"{_CA}.pem"), f"{here}.pem", f"{here}.key")

    def gate(self, router: Member) -> Identity:
        """Paths of a router's files, with the file of `admit` as the authorities it trusts."""
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
    """Write a pair, the key first: there is no certificate without its key."""
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
