"""Folder of a ward's certificate authority: its certificate and key, those of each member and issuer, and revoked names.

Each file is written under a temporary name and then renamed, so it is complete or absent. A renewal keeps the private
key: only the certificate file changes, and it always matches its key. Private keys are created with mode 0600.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from bridge.pki.authority import DAYS, EARLIER, Pair, check_hosts, issue, new_authority, new_issuer
from bridge.pki.certificate_checks import Identity, certificates, hosts_of, lasts_of, signer
from bridge.pki.certificate_files import Validity
from bridge.pki.member import Member
from bridge.runtime import whole_file
from bridge.runtime.regular_file import content

_CA, _ISSUERS, _MEMBERS, _REVOKED = "ca", "issuers", ".members.pem", "revoked.txt"


class Folder:
    """Folder of a ward's certificate authority, which issues, renews and revokes the certificates of members.

    Methods raise ValueError with a sentence for the user, and OSError for disk errors.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def make(self, name: str, now: datetime) -> None:
        """Create the authority's certificate and key. Raises ValueError if the folder has an authority already.

        name: the authority's common name. now: present time, a datetime in UTC; the validity begins 5 minutes before
        `now`.
        """
        if any((self.path / there).exists() for there in (f"{_CA}.pem", f"{_CA}.key", _ISSUERS)):
            raise ValueError(
                f"{self.path}: an authority exists already, and a new one would void all its certificates: use another --folder"
            )
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        _keep(self.path / _CA, new_authority(name, now))

    def issue(self, member: Member, now: datetime, days: int = DAYS, hosts: tuple[str, ...] = ()) -> Identity:
        """Issue a member's first certificate and key of its current generation; return the paths of the files.

        The current generation is the first that is not revoked.
        now: present time, a datetime in UTC; the validity begins 5 minutes before `now`. days: end of the validity, in
        days after `now`. hosts: host names and IP addresses, for the roles router and page (the dashboard's web
        server). Raises ValueError if the member has a certificate, a host is invalid, or the authority expires earlier.
        """
        member = self.current(member)
        files = self.identity(member)
        if Path(files.certificate).exists():
            raise ValueError(f"{files.certificate} exists already: extend it with `truerate pki renew {member.label}`")
        check_hosts(member, hosts)  # before an issuer is made
        pair = issue(self.issuer(member), member, now - EARLIER, now + timedelta(days=days), hosts=hosts)
        _keep(self.path / member.file, pair)
        return files

    def renew(self, member: Member, now: datetime, days: int | None = None) -> Identity:
        """Renew a certificate with the same name, key, hosts and issuer; return the paths of the files.

        now: present time, a datetime in UTC; the validity begins 5 minutes before `now`. days: end of the validity, in
        days after `now`; by default as long as for the old certificate, but not beyond the authority's end.
        Raises ValueError if the certificate or key is missing, if the authority has expired, or if it expires before
        the new certificate would.
        """
        member = self.current(member)
        files = self.identity(member)
        if missing := [path for path in (files.certificate, files.key) if not Path(path).exists()]:
            raise ValueError(
                f"{missing[0]} is missing, and a renewal needs certificate and key: copy the file back from the machine of"
                f" {member.label}, or revoke the name and issue a new pair: truerate pki issue {member.label}"
            )
        own = certificates(files.certificate)[0]
        hosts, lasted = hosts_of(own), lasts_of(own)
        key = content(files.key)
        if days is not None:
            ends = now + timedelta(days=days)
        elif now < (last := self.authority_lasts().ends):
            ends = min(now + (lasted.ends - lasted.begins - EARLIER), last)
        else:
            raise ValueError(
                f"the authority expires on {last:%Y-%m-%d}: make a new authority and issue all certificates again"
            )
        pair = issue(self.issuer(member), member, now - EARLIER, ends, hosts=hosts, key=key)
        whole_file.write(Path(files.certificate), pair.certificate, 0o644)
        return files

    def issuer(self, member: Member) -> Pair:
        """Return certificate and key of the issuer that signs a member's certificates; create the issuer if there is none.

        Raises ValueError if an issuer must be created and the folder has no authority.
        """
        here = self.path / _ISSUERS / member.file
        if not Path(f"{here}.pem").exists():
            if not all((self.path / f"{_CA}.{kind}").exists() for kind in ("key", "pem")):
                raise self._none()
            pair = new_issuer(_pair(self.path / _CA), member)
            here.parent.mkdir(mode=0o700, exist_ok=True)
            _keep(here, pair)
        return _pair(here)

    def admit(self, router: Member, members: Iterable[Member]) -> None:
        """Write the PEM file with the issuers' certificates that a router trusts; `gate` returns the file's path.

        members: programs that may connect to the router. The file has the issuer of each, and of the router itself.
        Raises ValueError if the certificate file of the router or of a member is unreadable.
        """
        issuers = [signer(self.identity(member).certificate) for member in (router, *members)]
        whole_file.write(Path(self.gate(router).ca), b"".join(issuers), 0o644)

    def revoke(self, member: Member, now: datetime, why: str) -> Member:
        """Revoke a member's current certificate; return the member with the generation that was revoked.

        Afterwards, the access rules of routers must be written again without that generation. now: time of the
        revocation, a datetime in UTC. why: reason, stored in the file of revoked names. Raises ValueError if the member
        has no certificate.
        """
        member = self.current(member)
        if not Path(self.identity(member).certificate).exists():
            raise ValueError(
                f"{self.path}: {member.label} has no certificate to revoke; list them with `truerate pki show`"
            )
        lines = [*self._lines(), f"{member.common_name} {now:%Y-%m-%dT%H:%M:%SZ} {' '.join(why.split())}"]
        whole_file.write(self.path / _REVOKED, "".join(f"{line}\n" for line in lines).encode(), 0o644)
        return member

    def revoked(self) -> dict[str, str]:
        """Return the revoked certificates: time (UTC) and reason in one text, by common name.

        Raises ValueError if a line of the file does not begin with a valid common name, or if the file is not UTF-8.
        """
        found = dict(line.partition(" ")[::2] for line in self._lines())
        for name in found:
            try:
                Member.parse(name)
            except ValueError as error:
                raise ValueError(f"{self.path / _REVOKED}: {error}; correct that line, or restore the file") from None
        return found

    def current(self, member: Member) -> Member:
        """Return the member in its first generation that is not revoked.

        The generation is a number that grows by one with each revocation of the member.
        Raises ValueError if a later generation has a certificate: the list of revoked names is then incomplete.
        """
        revoked, generation = self.revoked(), 1
        while (now := Member(member.role, member.name, generation)).common_name in revoked:
            generation += 1
        later = self.identity(replace(now, generation=generation + 1)).certificate
        if Path(later).exists():
            raise ValueError(
                f"{self.path / _REVOKED}: {now.common_name} was revoked before {later} was made, but is not listed. Restore"
                " the file; otherwise routers accept the revoked name again"
            )
        return now

    def members(self) -> Iterator[tuple[Member, Validity]]:
        """Yield each member with a certificate that is not revoked, and the certificate's validity period."""
        for path in sorted(self.path.glob("*.pem")):
            try:
                member = Member.parse(path.stem.replace(".", ":"))
            except ValueError:
                continue  # file of the authority, a router's issuers, or a foreign file
            if member == self.current(member):
                yield member, lasts_of(certificates(str(path))[0])

    def authority_lasts(self) -> Validity:
        """Return the validity period of the authority's certificate. Raises ValueError if there is no authority."""
        if not (path := self.path / f"{_CA}.pem").exists():
            raise self._none()
        return lasts_of(certificates(str(path))[0])

    def identity(self, member: Member) -> Identity:
        """Return the paths of a member's certificate, key and authority in this folder; the files need not exist."""
        here = self.path / member.file
        return Identity(str(self.path / f"{_CA}.pem"), f"{here}.pem", f"{here}.key")

    def gate(self, router: Member) -> Identity:
        """Return the paths of a router's certificate and key, and of the file of issuers that the router trusts (`admit`)."""
        return replace(self.identity(router), ca=str(self.path / f"{router.file}{_MEMBERS}"))

    def _none(self) -> ValueError:
        if (self.path / _ISSUERS).exists():
            return ValueError(f"{self.path}: ca.pem or ca.key is missing: copy the missing file here from your backup")
        return ValueError(
            f"{self.path}: no authority; make one with `truerate pki init --ward WARD --folder {self.path}`"
        )

    def _lines(self) -> list[str]:
        path = self.path / _REVOKED
        try:
            text = content(path).decode("utf-8-sig") if path.exists() else ""
        except UnicodeDecodeError:
            raise ValueError(f"{path} is not UTF-8 text: save the file as UTF-8 in your editor") from None
        return [line for line in text.splitlines() if line.strip()]


def utc_now() -> datetime:
    """Return the current time, a datetime in UTC in whole seconds, as certificates store it."""
    return datetime.now(UTC).replace(microsecond=0)


def _pair(here: Path) -> Pair:
    return Pair(content(f"{here}.pem"), content(f"{here}.key"))


def _keep(here: Path, pair: Pair) -> None:
    """Write a pair, the key first, so that no certificate exists without its key."""
    whole_file.write(Path(f"{here}.key"), pair.key, 0o600)
    whole_file.write(Path(f"{here}.pem"), pair.certificate, 0o644)
