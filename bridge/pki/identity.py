"""The files by which a program says who it is, looked through before anybody is shown them: what is wrong, in words."""

import re
import stat
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage

from bridge import os_words
from bridge.pki.chain import ISSUER_OF, Chain, common_name, dates, is_authority, key_of, unusable
from bridge.pki.member import Member, Role
from bridge.pki.papers import Identity, Lasts

__all__ = [
    "Identity",
    "by_authority",
    "certificates",
    "common_name",
    "exposed",
    "faults",
    "hosts_of",
    "lasts",
    "lasts_of",
    "member_of",
    "signer",
    "verified",
]

_BEGIN = re.compile(rb"^-----BEGIN ", re.MULTILINE)


def certificates(path: str) -> list[x509.Certificate]:
    """All of a PEM file, the holder's own first; ValueError says what is wrong with the file."""
    try:
        found = x509.load_pem_x509_certificates(Path(path).read_bytes())
    except OSError as error:
        raise ValueError(f"{path}: {os_words.why(error)}") from None
    except x509.InvalidVersion as error:
        raise ValueError(f"{path}: it cannot be read: {error}") from None
    except ValueError:
        raise ValueError(
            f"{path}: no certificate in PEM; such a file begins with -----BEGIN CERTIFICATE-----"
        ) from None
    try:
        for one in found:
            list(one.extensions)  # here once, for it is not by ValueErrors alone that they are refused
    except (ValueError, x509.DuplicateExtension, x509.UnsupportedGeneralNameType) as error:
        raise ValueError(f"{path}: it cannot be read: {error}") from None
    return found


def hosts_of(certificate: x509.Certificate) -> list[str]:
    """The names and addresses a router's certificate is for."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return [
        *names.get_values_for_type(x509.DNSName),
        *(str(address) for address in names.get_values_for_type(x509.IPAddress)),
    ]


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
    return bool(Chain.of(certificates(certificate), certificates(ca)).ends)


def lasts(identity: Identity) -> Lasts:
    """Of its own certificate and all above that which ends first; ValueError where one cannot be read."""
    chain = Chain.of(certificates(identity.certificate), certificates(identity.ca))
    tops = [max(chain.ends, key=lambda one: one.not_valid_after_utc)] if chain.ends else []
    return min((lasts_of(one) for one in (chain.own, *chain.between, *tops)), key=lambda one: one.ends)


def lasts_of(certificate: x509.Certificate) -> Lasts:
    """From when until when this one is good, whatever is above it."""
    return Lasts(certificate.not_valid_before_utc, certificate.not_valid_after_utc)


def by_authority(identity: Identity) -> bool:
    """Whether who has an issuer of its own goes by the authority, and so lets in whoever was revoked."""
    try:
        own, *between = certificates(identity.certificate)
        trusted = certificates(identity.ca)
    except ValueError:
        return False
    return any(
        common_name(one) == f"{ISSUER_OF}{common_name(own)}" for one in Chain.of([own, *between], trusted).between
    )


def faults(identity: Identity, now: datetime, roles: tuple[Role, ...] = tuple(Role)) -> list[str]:
    """All that is wrong, each a sentence that begins with the file; empty when it can be used for one of the roles."""
    try:
        trusted = certificates(identity.ca)
        given = certificates(identity.certificate)
    except ValueError as error:
        return [str(error), *_key_faults(identity, None)]
    try:
        return [
            *_text_faults(identity.ca, identity.certificate),
            *_keys_beside(identity),
            *_key_faults(identity, given[0]),
            *_certificate_faults(identity, Chain.of(given, trusted), now, roles),
        ]
    except ValueError as error:  # of a certificate that is well packed and holds nonsense
        return [f"{identity.certificate}: it cannot be read: {error}"]


def _text_faults(*paths: str) -> Iterator[str]:
    for path in paths:
        pem = Path(path).read_bytes()
        if len(_BEGIN.findall(pem)) < pem.count(b"-----BEGIN "):
            yield (
                f"{path}: there is something before -----BEGIN on its line, maybe a mark that an editor has put there (BOM):"
                " zenoh sees nothing in it"
            )


def _keys_beside(identity: Identity) -> Iterator[str]:
    """Of files that were put together for programs that take one alone."""
    for path in (identity.ca, identity.certificate):
        if path != identity.key and b" PRIVATE KEY-----" in Path(path).read_bytes() and (words := exposed(path)):
            yield f"{words}; there is a private key in it"


def exposed(key: str) -> str:
    """Why a private key is not private; empty where it is. Raises OSError."""
    mode = Path(key).stat().st_mode
    if not mode & (stat.S_IROTH | stat.S_IWGRP | stat.S_IWOTH):
        return ""
    return f"{key}: everybody on this machine may read or change it (mode {stat.S_IMODE(mode):04o}): chmod 600 {key}"


def _key_faults(identity: Identity, own: x509.Certificate | None) -> Iterator[str]:
    path = Path(identity.key)
    try:
        pem, words = path.read_bytes(), exposed(identity.key)
    except OSError as error:
        yield f"{path}: {os_words.why(error)}"
        return
    if words:
        yield words
    try:
        public = load_pem_private_key(pem, None).public_key()
    except UnsupportedAlgorithm:
        yield f"{path}: {unusable(None)}"
    except TypeError:
        yield f"{path}: it is locked with a password, which nobody types at night: store it without one, mode 0600"
    except ValueError:
        yield f"{path}: no private key in PEM; such a file begins with BEGIN PRIVATE KEY"
    else:
        yield from _text_faults(identity.key)
        form = Encoding.DER, PublicFormat.SubjectPublicKeyInfo
        certified = None if own is None else key_of(own)
        if certified is not None and public.public_bytes(*form) != certified.public_bytes(*form):
            yield f"{path}: not the key of {identity.certificate}: the two files come from different pairs"


def _certificate_faults(identity: Identity, chain: Chain, now: datetime, roles: tuple[Role, ...]) -> Iterator[str]:
    needed = {"ask a router (client authentication)": Usage.CLIENT_AUTH}
    try:
        member = Member.parse(common_name(chain.own))
    except ValueError as error:
        yield f"{identity.certificate}: its common name says no role: {error}"
    else:
        if member.role not in roles:
            wanted = " or ".join(role.value for role in roles)
            yield f"{identity.certificate}: for {member.label}, where a {wanted} is to be run: give it a certificate of its own"
        if member.role is Role.ROUTER:
            needed["serve (server authentication)"] = Usage.SERVER_AUTH
            if not hosts_of(chain.own):
                yield f"{identity.certificate}: it names no host (subject alternative name): nobody talks to such a router"
    yield from (f"{identity.certificate}: {words}" for words in dates(chain.own, now))
    yield from (f"{identity.certificate}: {words}" for words in chain.faults(now, needed))
    if not chain.ends:
        issuer, expected = chain.last.issuer, certificates(identity.ca)[0].subject
        another = " (another one of the same name: was `pki init` done twice?)" if issuer == expected else ""
        yield (
            f"{identity.certificate}: not signed by {identity.ca} ({common_name(certificates(identity.ca)[0])!r}), but by"
            f" {issuer.rfc4514_string()!r}{another}: use that authority's file, or add what lies between to the certificate's"
        )
    yield from (f"{identity.ca}: {words}" for words in chain.end_faults(now))
    yield from (
        f"{identity.ca}: the certificate of {common_name(one)!r} in it is no authority's: is it the right file?"
        for one in certificates(identity.ca)
        if not is_authority(one)
    )
