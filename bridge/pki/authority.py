"""Certificate authority for a ward: creates X.509 certificates with the package `cryptography`. PEM bytes in and out, no I/O.

Keys are ECDSA on P-256, in PKCS 8. Extended key usages:

- router: server and client authentication; the latter is for connections to other routers
- page (the dashboard's web server): server authentication only
- all other roles: client authentication only, so that a stolen bridge cannot pose as a router

Each member has its own issuer, an intermediate authority below the ward's authority. A router trusts the issuers of its
members, without those of revoked members. Issuers' keys stay beside the authority's key, so no further restriction on
what an issuer may sign is needed.
"""

import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage
from cryptography.x509.oid import NameOID

from bridge.pki.certificate_checks import ISSUER_OF
from bridge.pki.member import Member, Role

#: default validity of a member's certificate and of an authority, days
DAYS, CA_DAYS = 90, 3650
_USAGES = {Role.ROUTER: [Usage.CLIENT_AUTH, Usage.SERVER_AUTH], Role.PAGE: [Usage.SERVER_AUTH]}
#: largest clock difference between machines of a ward; certificates begin this much earlier
EARLIER = timedelta(minutes=5)
_LABEL = r"(?!-)[a-z0-9_-]{1,63}(?<!-)"
_NAME = re.compile(rf"(?:\*\.)?(?:{_LABEL}\.)*(?!\d+\Z){_LABEL}\Z", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Pair:
    """Certificate and its private key, as PEM bytes. A member's certificate is followed by its issuer's certificate."""

    certificate: bytes
    key: bytes


def new_authority(name: str, now: datetime, days: int = CA_DAYS) -> Pair:
    """Create a self-signed certificate authority; return its certificate and key.

    name: common name of the authority. now: datetime in UTC. days: end of the validity, in days after `now`; the
    validity begins 5 minutes before `now`.
    """
    key = ec.generate_private_key(ec.SECP256R1())
    made = _begun(name, _subject(name), key, now - EARLIER, now + timedelta(days=days), below=1)
    return Pair(_signed(made, key), _pem(key))


def new_issuer(authority: Pair, member: Member) -> Pair:
    """Create the issuer (intermediate authority) that signs the certificates of one member; return its certificate and key.

    The issuer is valid as long as the authority.
    """
    ca, key = x509.load_pem_x509_certificate(authority.certificate), ec.generate_private_key(ec.SECP256R1())
    name = f"{ISSUER_OF}{member.common_name}"
    made = _begun(name, ca.subject, key, ca.not_valid_before_utc, ca.not_valid_after_utc, below=0)
    return Pair(_signed(made, _private(authority.key)), _pem(key))


def issue(
    authority: Pair,
    member: Member,
    begins: datetime,
    ends: datetime,
    *,
    hosts: Sequence[str] = (),
    key: bytes | None = None,
    usages: Sequence[x509.ObjectIdentifier] = (),
) -> Pair:
    """Issue a member's certificate, followed by its issuer's certificate in the same PEM.

    authority: the signer, which is the member's issuer or an authority. begins, ends: validity period, datetimes in
    UTC.
    hosts: host names and IP addresses, for the roles router and page; clients refuse the certificate under any other
    name. key: PEM of the private key; None creates a new key. usages: extended key usages; by default those of the
    role. Raises ValueError for invalid hosts, an invalid key, or an end later than the authority's.
    """
    names = check_hosts(member, hosts)
    ca = x509.load_pem_x509_certificate(authority.certificate)
    if ends > ca.not_valid_after_utc:
        raise ValueError(
            f"the authority expires on {ca.not_valid_after_utc:%Y-%m-%d}: use fewer --days, or make a new authority"
        )
    own = ec.generate_private_key(ec.SECP256R1()) if key is None else _private(key)
    usage = list(usages) or _USAGES.get(member.role, [Usage.CLIENT_AUTH])
    made = (
        _begun(member.common_name, ca.subject, own, begins, ends)
        .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
    )
    between = authority.certificate if ca.issuer != ca.subject else b""
    return Pair(_signed(made, _private(authority.key)) + between, _pem(own))


def check_hosts(member: Member, hosts: Sequence[str]) -> list[x509.GeneralName]:
    """Return a certificate's subject alternative names: the hosts, or without hosts a URI with the member's common name.

    Raises ValueError if a member with the role router or page has no hosts, and for an invalid host.
    """
    if member.role.serves and not hosts:
        role = member.role.value
        raise ValueError(f"a {role}'s certificate needs the {role}'s host names or addresses: give each with --host")
    return [_host(host) for host in hosts] or [x509.UniformResourceIdentifier(f"urn:truerate:{member.common_name}")]


def _host(text: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(text))
    except ValueError:
        if len(text) > 253 or not _NAME.match(text):
            raise ValueError(
                f"--host {text!r} is neither a name nor an address: write ward-3.example or 10.0.0.5, without a port"
            ) from None
    return x509.DNSName(text)


def _private(pem: bytes) -> ec.EllipticCurvePrivateKey:
    try:
        key = serialization.load_pem_private_key(pem, None)
    except TypeError:
        raise ValueError(
            "the private key has a password: remove the password with openssl pkey -in FILE -out NEW"
        ) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        wrong = f"truerate does not make keys of type {type(key).__name__}"
        raise ValueError(f"{wrong}: renew the certificate with the tool that made it")  # noqa: TRY004
    return key


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _signed(made: x509.CertificateBuilder, signer: ec.EllipticCurvePrivateKey) -> bytes:
    by = x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key())
    return made.add_extension(by, critical=False).sign(signer, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _begun(
    name: str,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    begins: datetime,
    ends: datetime,
    below: int | None = None,
) -> x509.CertificateBuilder:
    """Prepare a certificate for signing. below: path length of an authority; None for a certificate that signs no others."""
    signs = below is not None
    may = x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
    return (
        x509.CertificateBuilder()
        .subject_name(_subject(name))
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begins)
        .not_valid_after(ends)
        .add_extension(x509.BasicConstraints(ca=signs, path_length=below), critical=True)
        .add_extension(may, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
