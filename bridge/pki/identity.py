"""The files by which a program says who it is, looked through before anybody is shown them: what is wrong, in words."""

import stat
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage
from cryptography.x509.oid import NameOID

from bridge import os_words
from bridge.pki.member import Member, Role

SOON = timedelta(days=14)


@dataclass(frozen=True, slots=True)
class Identity:
    """Paths of PEM files: whose word counts (ca), who we are, and the key that proves it."""

    ca: str
    certificate: str
    key: str


def common_name(certificate: x509.Certificate) -> str:
    """Empty where it has none."""
    found = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(found[0].value) if found else ""


def certificates(path: str) -> list[x509.Certificate]:
    """All of a PEM file, the holder's own first; ValueError says what is wrong with the file."""
    try:
        return x509.load_pem_x509_certificates(Path(path).read_bytes())
    except OSError as error:
        raise ValueError(f"{path}: {os_words.why(error)}") from None
    except ValueError:
        raise ValueError(
            f"{path}: no certificate in PEM; such a file begins with -----BEGIN CERTIFICATE-----"
        ) from None


def signer(path: str) -> bytes:
    """Who signed a certificate, PEM, where its file brings that along; else nothing."""
    chain = certificates(path)
    return chain[1].public_bytes(Encoding.PEM) if len(chain) > 1 else b""


def member_of(identity: Identity) -> Member:
    """Who the certificate is for; ValueError where it does not say a role."""
    own = certificates(identity.certificate)[0]
    try:
        return Member.parse(common_name(own))
    except ValueError as error:
        raise ValueError(f"{identity.certificate}: its common name says no role: {error}") from None


def verified(certificate: str, ca: str) -> bool:
    """Whether a certificate is good to who goes by this file of authorities, dates aside; ValueError where one is no PEM."""
    own, *between = certificates(certificate)
    return _end(own, between, certificates(ca)) is None


def faults(identity: Identity, now: datetime, roles: tuple[Role, ...] = tuple(Role)) -> list[str]:
    """All that is wrong, each a sentence that begins with the file; empty when it can be used for one of the roles."""
    try:
        trusted = certificates(identity.ca)
        own, *between = certificates(identity.certificate)
    except ValueError as error:
        return [str(error), *_key_faults(identity, None)]
    return [
        *_key_faults(identity, own),
        *_date_faults(identity.certificate, own, now),
        *_date_faults(identity.ca, trusted[0], now),
        *_chain_faults(identity, own, between, trusted),
        *_usage_faults(identity, own, roles),
    ]


def _key_faults(identity: Identity, own: x509.Certificate | None) -> Iterator[str]:
    path = Path(identity.key)
    try:
        pem, mode = path.read_bytes(), path.stat().st_mode
    except OSError as error:
        yield f"{path}: {os_words.why(error)}"
        return
    if mode & (stat.S_IROTH | stat.S_IWGRP | stat.S_IWOTH):
        yield f"{path}: everybody on this machine may read or change it (mode {stat.S_IMODE(mode):04o}): chmod 600 {path}"
    try:
        public = load_pem_private_key(pem, None).public_key()
    except TypeError:
        yield f"{path}: it is locked with a password, which nobody types at night: store it without one, mode 0600"
    except ValueError:
        yield f"{path}: no private key in PEM; such a file begins with -----BEGIN PRIVATE KEY-----"
    else:
        form = Encoding.DER, PublicFormat.SubjectPublicKeyInfo
        if own is not None and public.public_bytes(*form) != own.public_key().public_bytes(*form):
            yield f"{path}: not the key of {identity.certificate}: the two files come from different pairs"


def _date_faults(path: str, certificate: x509.Certificate, now: datetime) -> Iterator[str]:
    if now < certificate.not_valid_before_utc:
        yield (
            f"{path}: not valid before {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC; here it is {now:%Y-%m-%d %H:%M}:"
            " is this machine's clock right?"
        )
    if now > certificate.not_valid_after_utc:
        yield f"{path}: expired on {certificate.not_valid_after_utc:%Y-%m-%d %H:%M} UTC: renew it (truerate pki renew)"


def _chain_faults(
    identity: Identity, own: x509.Certificate, between: list[x509.Certificate], trusted: list[x509.Certificate]
) -> Iterator[str]:
    if (last := _end(own, between, trusted)) is not None:
        yield (
            f"{identity.certificate}: not signed by {identity.ca} ({common_name(trusted[0])!r}), but by"
            f" {last.issuer.rfc4514_string()!r}: use that authority's file, or add what lies between to the certificate's"
        )


def _end(
    own: x509.Certificate, between: list[x509.Certificate], trusted: list[x509.Certificate]
) -> x509.Certificate | None:
    """From the holder's own up through what its file brings along: None at one that is trusted, else whose signer is missing."""
    at, left = own, list(between)
    while not any(_signed(at, ca) for ca in trusted):
        issuer = next((one for one in left if _signed(at, one)), None)
        if issuer is None:
            return at
        left.remove(issuer)
        at = issuer
    return None


def _signed(certificate: x509.Certificate, issuer: x509.Certificate) -> bool:
    try:
        certificate.verify_directly_issued_by(issuer)
        return issuer.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except (ValueError, TypeError, InvalidSignature, x509.ExtensionNotFound):
        return False


def _usage_faults(identity: Identity, own: x509.Certificate, roles: tuple[Role, ...]) -> Iterator[str]:
    try:
        member = Member.parse(common_name(own))
    except ValueError as error:
        yield f"{identity.certificate}: its common name says no role: {error}"
        return
    if member.role not in roles:
        wanted = " or ".join(role.value for role in roles)
        yield f"{identity.certificate}: for {member.label}, where a {wanted} is to be run: give it a certificate of its own"
    try:
        usages = list(own.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    except x509.ExtensionNotFound:
        return  # then it is for any
    needed = {"ask a router (client authentication)": Usage.CLIENT_AUTH}
    if member.role is Role.ROUTER:
        needed["serve (server authentication)"] = Usage.SERVER_AUTH
    for what, usage in needed.items():
        if usage not in usages and Usage.ANY_EXTENDED_KEY_USAGE not in usages:
            yield f"{identity.certificate}: its extended key usage does not let it {what}"
