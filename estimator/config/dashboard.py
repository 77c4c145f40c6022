"""Table [dashboard] of a ward's file: the address of the page, and the people who may give commands.

The router's rules decide which programs may give commands; docs/security.md describes the rights of people
and of programs.
"""

import re
from ipaddress import ip_address
from typing import Literal, get_args

from msgspec import Struct

from bridge.config.schema import check, listening

#: scheme, host and perhaps port of a page, as a browser sends it
_ORIGIN = re.compile(r"https?://[a-z0-9.\[\]:-]+")
#: prefix of an argon2 hash
HASHED = "$argon2id$"
#: what a person may do: give commands, or also manage the people
PersonRole = Literal["operator", "administrator"]
PERSON_ROLES: tuple[PersonRole, ...] = get_args(PersonRole)


class Person(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Person who may give commands on the page (recalibrate, cancel, add notes): one [[dashboard.people]] table.

    Raises ValueError for an invalid name, and for a password that is not a hash.
    """

    #: name for the login and the audit log, for example `nurse`
    name: str
    #: hash of the password, as `truerate people` writes it; never the password itself
    password: str
    #: `administrator` may also manage the people on the page
    role: PersonRole = "operator"

    def __post_init__(self) -> None:
        check(self.name, "name")
        if not self.password.startswith(HASHED):
            raise ValueError(f"password of {self.name!r} is not a hash: let `truerate people password` write it")


class OpenId(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of login by an OpenID Connect provider, such as the hospital's; needs `pip install 'truerate[openid]'`.

    Raises ValueError for an invalid issuer, and without roles.
    """

    #: address of the provider, as in its tokens
    issuer: str
    #: id of this page at the provider; register the redirect address https://HOST/openid/back there
    client_id: str
    #: file with the client's secret
    secret_file: str
    #: role by value of `claim`: `{ nurses = "operator", it = "administrator" }`; nobody else is let in
    roles: dict[str, PersonRole]
    #: claim of the token with the person's groups: text or a list
    claim: str = "groups"
    #: claim of the token with the person's name, for the audit
    name_claim: str = "preferred_username"

    def __post_init__(self) -> None:
        if not re.match(r"https://[^/]|http://(localhost|127\.0\.0\.1)[:/]", self.issuer):
            raise ValueError(f"issuer is {self.issuer!r}; write for example 'https://login.hospital.example'")
        if not self.roles:
            raise ValueError("roles is empty, so nobody could log in: give a role for a group")


class Dashboard(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the web page. Everybody who can reach the page may see it; the listed people may also give commands.

    A comment at each field states its meaning and unit. Raises ValueError for an invalid or contradictory setting.
    """

    #: address and port
    listen: str = "127.0.0.1:8090"
    #: one table `[[dashboard.people]]` for each person, with `name` and `password` (a hash)
    people: tuple[Person, ...] = ()
    #: separate file with the people only, which the services may write; `truerate init` makes the file
    people_file: str = ""
    #: login by an OpenID Connect provider
    openid: OpenId | None = None
    #: host names under which browsers open the page, besides `listen`
    hosts: tuple[str, ...] = ()
    #: other sites whose pages may read the stream, such as "https://lab.example"; programs outside a browser need no entry
    origins: tuple[str, ...] = ()
    #: certificate chain (PEM) that browsers see, for TLS; `truerate pki issue page:NAME --host HOST` makes one
    certificate: str = ""
    #: private key of the certificate (PEM)
    key: str = ""
    #: set to true if a reverse proxy on this machine ends TLS and passes on the visitor's address
    behind_proxy: bool = False
    #: hours until a person has to log in again
    session_hours: float = 8.0
    #: minutes without a request or command until a person has to log in again
    idle_minutes: float = 30.0
    #: days after which a calibration certificate asks for a new calibration
    due_days: float = 365.0

    def __post_init__(self) -> None:
        try:
            listening(self.listen)
        except ValueError:
            raise ValueError(f"listen is {self.listen!r}; write for example '127.0.0.1:8090'") from None
        if bool(self.certificate) != bool(self.key):
            raise ValueError(
                f"{'key' if self.certificate else 'certificate'} is missing: TLS needs `certificate` and `key`"
            )
        names = [person.name for person in self.people]
        for name in {name for name in names if names.count(name) > 1}:
            raise ValueError(f"two people are called {name!r}: rename one of them")
        if self.people and self.people_file:
            raise ValueError(
                f"[[dashboard.people]] and {self.people_file} both list people: move all people to {self.people_file}"
            )
        for host in self.hosts:
            if not host or not host.isprintable() or set(host) & set("/:@ *"):
                raise ValueError(
                    f"hosts: {host!r} is not a host name: write for example 'ward-3.hospital.example', without a port"
                )
        for origin in self.origins:
            if not _ORIGIN.fullmatch(origin):
                raise ValueError(
                    f"origins: {origin!r} is not an origin: write for example 'https://lab.example' or 'http://localhost:8000'"
                )
        if not 0.05 <= self.session_hours <= 168:
            raise ValueError(f"session_hours is {self.session_hours:g}; allowed: 0.05 to 168")
        if not 1 <= self.idle_minutes <= 10_080:
            raise ValueError(f"idle_minutes is {self.idle_minutes:g}; allowed: 1 to 10080")
        if not 1 <= self.due_days <= 3650:
            raise ValueError(f"due_days is {self.due_days:g}; allowed: 1 to 3650")

    @property
    def commanded(self) -> bool:
        """True if anybody may give commands: people are listed, or log in by OpenID Connect."""
        return bool(self.people or self.people_file or self.openid)

    @property
    def local(self) -> bool:
        """True if only this machine can reach the page, as `listen` is a loopback address."""
        host, _ = listening(self.listen)
        try:
            return ip_address(host).is_loopback
        except ValueError:
            return host == "localhost"
