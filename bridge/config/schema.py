"""Schema of the ward file (TOML), which configures both the bridge and the estimator.

The estimator's subclass of `Root` defines the tables `estimator`, `dashboard` and `alerts`. `Root` itself accepts any
content in these tables.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Self

from msgspec import Struct

from bridge.bucket.bucket import S3
from bridge.bus.routers import Routers, secured
from bridge.config.enrolment import Enrolment
from bridge.drivers import registry
from bridge.drivers.driver import Driver
from bridge.pki.certificate_files import Identity, identities_in
from bridge.pki.member import Role
from bridge.recording.settings import Recorder
from bridge.runtime import os_errors
from bridge.toml.loader import ConfigError, load, nearest, options
from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal

__all__ = ["Bridge", "Bus", "ConfigError", "Device", "Root", "Router", "check", "check_endpoints", "load"]

#: default endpoint of a router on this machine
LOCAL = "tcp/127.0.0.1:7447"
PROTOCOLS = ("tcp", "udp", "tls", "quic", "ws", "unixsock-stream")
#: listen hosts that stand for all addresses of a machine
ANYWHERE = ("0.0.0.0", "::", "*")  # noqa: S104 - compared, not listened on
_ADDRESS = re.compile(r"[^?#\s]+:(\d{1,5})(?:[?#].*)?\Z")


def check(text: object, what: str) -> str:
    """Validate an id in the configuration and return it. Raises ValueError with the expected format.

    what: name of the id in the error message.
    """
    try:
        return check_id(text, what)
    except Refusal as refusal:
        raise ValueError(refusal.detail) from None


def check_endpoints(endpoints: Sequence[str], key: str) -> tuple[str, ...]:
    """Validate zenoh endpoints PROTOCOL/HOST:PORT and return them as a tuple.

    key: name of the setting or command-line option, with which the error message begins.
    Raises ValueError for an invalid endpoint, for two equal endpoints, or if there is no endpoint.
    """
    if not endpoints:
        raise ValueError(f"{key} needs at least one endpoint, such as {LOCAL!r}")
    if twice := [endpoint for endpoint in dict.fromkeys(endpoints) if endpoints.count(endpoint) > 1]:
        raise ValueError(f"{key}: {twice[0]!r} is listed twice: remove one")
    for endpoint in endpoints:
        protocol, _, address = endpoint.partition("/")
        if not (protocol and address and endpoint.isprintable()):
            raise ValueError(f"{key}: {endpoint!r} is not an endpoint: write PROTOCOL/HOST:PORT, such as {LOCAL!r}")
        if protocol not in PROTOCOLS:
            raise ValueError(f"{key}: {endpoint!r}: unknown protocol {protocol!r}; {nearest(protocol, PROTOCOLS)}")
        if protocol == "unixsock-stream":
            continue
        if not (match := _ADDRESS.match(address)):
            raise ValueError(f"{key}: {endpoint!r} has no port: write PROTOCOL/HOST:PORT, such as {LOCAL!r}")
        if int(match[1]) > 65535:
            raise ValueError(f"{key}: {endpoint!r}: invalid port {match[1]}: use 1 to 65535")
    return tuple(endpoints)


def listening(address: str) -> tuple[str, int]:
    """Parse the `health` address `HOST:PORT` to (host, port); an IPv6 host is returned without brackets.

    Raises ValueError, with the expected format, for any other text.
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65535 or not address.isprintable():
        raise ValueError(f"health is {address!r}: write HOST:PORT, such as '127.0.0.1:9464'")
    return host.removeprefix("[").removesuffix("]"), int(port)


def clash(address: str, other: str) -> bool:
    """Return True if two listen addresses `HOST:PORT` cannot be used at the same time on one machine.

    The ports must be equal, and the hosts equal or one of them a wildcard for all addresses, such as 0.0.0.0.
    Raises ValueError for an invalid address.
    """
    (host, port), (there, its) = (listening(one.replace("localhost", "127.0.0.1")) for one in (address, other))
    return port == its and (host == there or not {host, there}.isdisjoint(ANYWHERE))


class Bus(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [bus] of the ward file: the routers to connect to, and the certificates to show to the routers.

    Raises ValueError for an invalid endpoint, an incomplete set of certificate files, `tls` without certificates, and
    certificates without `tls`.
    """

    #: zenoh endpoints of the routers, the nearest first: `tcp/127.0.0.1:7447`, `tls/ward-3.example:7447`
    connect: tuple[str, ...] = (LOCAL,)
    #: for `tls/...`: folder with `ca.pem` and this machine's certificates; each program uses the certificate of its role
    pki: str = ""
    #: for `tls/...`, in place of `pki`: PEM file of the authority that signed all certificates
    ca: str = ""
    #: PEM file of this program's certificate
    certificate: str = ""
    #: PEM file of the certificate's private key; mode 0600
    key: str = ""

    def __post_init__(self) -> None:
        check_endpoints(self.connect, "connect")
        files = {"ca": self.ca, "certificate": self.certificate, "key": self.key}
        missing = [name for name, path in files.items() if not path]
        if self.pki and len(missing) < len(files):
            raise ValueError(
                "pki is given together with ca, certificate or key: give either the folder pki or the three files"
            )
        if 0 < len(missing) < len(files):
            raise ValueError(f"{', '.join(missing)} missing: give ca, certificate and key together, or none of them")
        for endpoint in self.connect:
            if secured(endpoint) and not self.certified:
                raise ValueError(
                    f"connect: {endpoint!r} needs pki, or ca, certificate and key; make them with `truerate pki issue`"
                )
            if not secured(endpoint) and self.certified:
                raise ValueError(
                    f"connect: {endpoint!r} uses no certificate: write a tls endpoint, such as 'tls/10.0.0.5:7447'"
                )

    @property
    def certified(self) -> bool:
        """True if the table names certificates, which programs then show to the routers."""
        return bool(self.pki or self.key)

    def every(self) -> list[Routers]:
        """Return one Routers object for each certificate of this machine's programs, each with all router endpoints.

        If the table names no certificates, the result is one Routers object without identity. If the folder of the
        setting `pki` has no certificate, the identity in the result has paths that do not exist. A later check then
        reports these paths.
        """
        if self.key:
            return [Routers(self.connect, Identity(self.ca, self.certificate, self.key))]
        known = (
            [one for member, one in identities_in(Path(self.pki)).items() if not member.role.serves] if self.pki else []
        )
        return [Routers(self.connect, one) for one in known] or [Routers(self.connect, self._lacking())]

    def _lacking(self) -> Identity | None:
        """Return paths of certificate files that do not exist, so that a check reports the folder `pki`.

        None without certificates.
        """
        here = f"{self.pki}/ROLE.NAME"
        return Identity(f"{self.pki}/ca.pem", f"{here}.pem", f"{here}.key") if self.pki else None

    def routers_as(self, *roles: Role, name: str = "") -> Routers:
        """Return the routers' endpoints with a certificate for one of the roles; earlier roles are preferred.

        name: id that the certificate must have; "" for any. Without certificates, the result has no identity.
        Raises ConfigError if no certificate fits. With a certificate of another role, a router would accept the
        connection and then silently drop all messages.
        """
        wanted = " or ".join(f"{role.value}:{name}" if name else role.value for role in roles)
        make = f"Run truerate pki issue {wanted.split(' or ')[0]}{'' if name else ':NAME'}"
        if self.pki:
            known = identities_in(Path(self.pki))
            for role in roles:
                for member, identity in known.items():
                    if member.role is role and name in ("", member.name):
                        return Routers(self.connect, identity)
            try:
                next(Path(self.pki).iterdir(), None)
            except OSError as error:
                raise ConfigError(f"[bus]: pki: {self.pki} cannot be read: {os_errors.why(error)}") from None
            raise ConfigError(f"[bus]: pki: {self.pki} has no certificate for {wanted}. {make}")
        routers = self.every()[0]
        if routers.identity is not None:
            from bridge.pki.certificate_checks import member_of  # noqa: PLC0415 - as in bridge.bus.routers

            try:
                member = member_of(routers.identity)
            except ValueError as error:
                raise ConfigError(f"[bus]: {error}") from None
            if member.role not in roles or (name and member.name != name):
                raise ConfigError(
                    f"[bus]: {self.certificate} is for {member.label}, but this program needs a certificate for {wanted}; routers"
                    f" would drop its messages. {make}"
                )
        return routers


class Router(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [router] of the ward file: endpoints on which `truerate router` listens."""

    #: zenoh endpoints to listen on
    listen: tuple[str, ...] = (LOCAL,)

    def __post_init__(self) -> None:
        check_endpoints(self.listen, "listen")


class Device:
    """Table [[bridge.devices]] of the ward file: device id, driver name, and the driver's options.

    Two devices are equal if all three are equal.
    """

    __slots__ = ("driver", "id", "options")

    def __init__(self, id: str, driver: str, options: Struct) -> None:  # noqa: A002 - as in the file
        self.id: Final = id
        self.driver: Final = driver
        self.options: Final = options

    @classmethod
    def from_table(cls, table: dict[str, Any]) -> Self:
        """Build a device from its TOML table: the keys `id` and `driver`, and the options of that driver.

        Raises ValueError for a missing or invalid id, an unknown driver, and an invalid option.
        """
        rest = dict(table)
        for key in ("id", "driver"):
            if key not in rest:
                raise ValueError(f"the key {key!r} is missing: add it")
        device, name = check(rest.pop("id"), "id"), rest.pop("driver")
        kinds = registry.kinds()
        if not isinstance(name, str) or name not in kinds:
            raise ValueError(f"unknown driver {name!r}; {nearest(str(name), kinds)}")
        return cls(device, name, options(rest, kinds[name].options))

    def __eq__(self, other: object) -> bool:
        """Return whether both tables have the same id, driver and options."""
        return isinstance(other, Device) and self._told == other._told

    def __hash__(self) -> int:
        """Hash of the device's id."""
        return hash(self.id)

    @property
    def _told(self) -> tuple[object, ...]:
        return self.id, self.driver, self.options

    def make(self) -> Driver:
        """Create the driver that reads the device; its port or file is not opened yet."""
        return registry.kinds()[self.driver].make(self.options)


class Bridge(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [bridge] of the ward file: id, publishing interval, health address and devices of a bridge.

    batch_ms: publishing interval, ms. health: `HOST:PORT` of the server for health and metrics; "" for none. Raises
    ValueError for an invalid value, and for two devices with the same id or the same port.
    """

    #: name of the bridge in keys and certificates
    id: str
    #: milliseconds between two messages of a device, 5 to 1000
    batch_ms: float = 50.0
    #: address of /metrics, /healthz and /readyz, for example `127.0.0.1:9465`
    health: str = ""
    #: one table `[[bridge.devices]]` per device; see below
    devices: tuple[Device, ...] = ()

    def __post_init__(self) -> None:
        check(self.id, "id")
        if self.health:
            listening(self.health)
        if not 5 <= self.batch_ms <= 1000:
            raise ValueError(f"batch_ms is {self.batch_ms:g}: use 5 to 1000 milliseconds")
        seen: dict[str, int] = {}
        for number, device in enumerate(self.devices, 1):
            if device.id in seen:
                raise ValueError(f"devices #{seen[device.id]} and #{number} have the same id {device.id!r}: rename one")
            seen[device.id] = number
        ports: dict[str, str] = {}
        for device in self.devices:
            port = getattr(device.options, "port", None)
            if port is None:
                continue
            place = port if "://" in port else os.path.realpath(port)  # a serial port has several names
            if place in ports:
                raise ValueError(
                    f"devices {ports[place]!r} and {device.id!r} have the same port {port!r}: give each device its own port"
                )
            ports[place] = device.id


class Root(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Whole content of a ward file, with one field per TOML table. A missing table has its defaults, or is None.

    ward: id of the ward; ValueError is raised for an invalid one.
    The estimator's subclass defines the types of `estimator`, `dashboard` and `alerts`.
    """

    ward: str
    bus: Bus = Bus()
    router: Router = Router()
    bridge: Bridge | None = None
    devices: Enrolment | None = None
    recorder: Recorder = Recorder()
    s3: S3 | None = None
    estimator: Any = None
    dashboard: Any = None
    alerts: Any = None

    def __post_init__(self) -> None:
        check(self.ward, "ward")
