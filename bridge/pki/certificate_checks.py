"""Checks of a certificate, its key and its authorities before a connection. Faults are returned as English sentences."""

import stat
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage
from cryptography.x509.oid import NameOID

from bridge.pki.certificate_files import Identity, Validity
from bridge.pki.member import Member, Role
from bridge.runtime import os_errors
from bridge.runtime.regular_file import content

__all__ = [
    "ISSUER_OF",
    "Identity",
    "certificates",
    "common_name",
    "faults",
    "hosts_of",
    "lasts",
    "lasts_of",
    "member_of",
    "signer",
]

#: prefix of an issuer's common name, before the common name of its member
ISSUER_OF = "issuer of "


def certificates(path: str) -> list[x509.Certificate]:
    """Read all certificates of a PEM file, the holder's own first. Raises ValueError for an unreadable or invalid file."""
    try:
        found = x509.load_pem_x509_certificates(content(path))
        for one in found:
            list(one.extensions), one.subject, one.public_key()  # parsed lazily: force errors now
    except OSError as error:
        raise ValueError(f"{path}: {os_errors.why(error)}") from None
    except (
        ValueError,
        x509.InvalidVersion,
        x509.DuplicateExtension,
        x509.UnsupportedGeneralNameType,
        UnsupportedAlgorithm,
    ) as error:
        raise ValueError(
            f"{path}: not a PEM certificate, which begins with -----BEGIN CERTIFICATE----- ({error}): give the .pem file"
        ) from None
    return found


def common_name(certificate: x509.Certificate) -> str:
    """Return the common name of a certificate; "" if it has none."""
    found = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(found[0].value) if found else ""


def hosts_of(certificate: x509.Certificate) -> list[str]:
    """Return the host names and IP addresses in a certificate; [] if it has none.

    Certificates of routers and of the dashboard's web server have them, as subject alternative names.
    """
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return [*names.get_values_for_type(x509.DNSName), *map(str, names.get_values_for_type(x509.IPAddress))]


def signer(path: str) -> bytes:
    """Return the second certificate of a PEM file, which is the issuer of the first, as PEM bytes.

    Raises ValueError for an unreadable file, and for a file with a single certificate.
    """
    found = certificates(path)
    if len(found) < 2:
        raise ValueError(
            f"{path} holds only one certificate; the issuer's certificate must follow in the same file: restore the file, or run"
            " `truerate pki renew`"
        )
    return found[1].public_bytes(Encoding.PEM)


def member_of(identity: Identity) -> Member:
    """Return the member (role, name, generation) that the certificate's common name states.

    Raises ValueError if the file is unreadable or the common name contains no role.
    """
    try:
        return Member.parse(common_name(certificates(identity.certificate)[0]))
    except ValueError as error:
        raise ValueError(f"{identity.certificate}: its common name contains no role: {error}") from None


def lasts(identity: Identity) -> Validity:
    """Return the validity period of the certificate that expires first in an identity's certificate chain.

    The chain ends at a trusted authority. If several trusted authorities fit, the one that expires last is used.
    Raises ValueError for an unreadable file.
    """
    chain, ends = _chain(certificates(identity.certificate), certificates(identity.ca))
    latest = sorted(map(lasts_of, ends), key=lambda one: one.ends)[-1:]
    return min((*map(lasts_of, chain), *latest), key=lambda one: one.ends)


def lasts_of(certificate: x509.Certificate) -> Validity:
    """Return the validity period of a single certificate in UTC, without regard to its issuers."""
    return Validity(certificate.not_valid_before_utc, certificate.not_valid_after_utc)


def faults(identity: Identity, now: datetime, roles: tuple[Role, ...] = tuple(Role)) -> list[str]:
    """Check an identity's certificate, key, chain and file permissions; return all faults as sentences, [] if there are none.

    Each sentence begins with the path of the file. now: time at which the chain must be valid, a datetime with time
    zone.
    roles: roles accepted in the certificate.
    """
    try:
        trusted = certificates(identity.ca)
        given = certificates(identity.certificate)
    except ValueError as error:
        return [str(error), *_key_faults(identity, None)]
    return [
        *_place_faults(identity),
        *_key_faults(identity, given[0]),
        *(f"{identity.certificate}: {words}" for words in _role_faults(given[0], roles)),
        *_chain_faults(identity, given, trusted, now),
    ]


def _place_faults(identity: Identity) -> Iterator[str]:
    """Yield the files and folders in which any user of this machine could put another authority, certificate or key."""
    files = dict.fromkeys(Path(path) for path in (identity.ca, identity.certificate))
    for place in (*files, *dict.fromkeys(path.parent for path in (*files, Path(identity.key)))):
        mode = place.stat().st_mode if place.exists() else 0  # what is missing has a fault of its own
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            yield f"{place}: every user of this machine can change it (mode {stat.S_IMODE(mode):04o}): chmod o-w {place}"


def _key_faults(identity: Identity, own: x509.Certificate | None) -> Iterator[str]:
    path, form = Path(identity.key), (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    try:
        pem, mode = content(path), path.stat().st_mode
        public = load_pem_private_key(pem, None).public_key().public_bytes(*form)
    except OSError as error:
        yield f"{path}: {os_errors.why(error)}"
        return
    except TypeError:
        yield f"{path}: the key has a password, but programs start unattended: store the key without a password, mode 0600"
        return
    except (ValueError, UnsupportedAlgorithm):
        yield f"{path}: not a PEM private key, which begins with BEGIN PRIVATE KEY: give the .key file"
        return
    if mode & (stat.S_IROTH | stat.S_IWGRP | stat.S_IWOTH):
        yield f"{path}: other users of this machine can read or change the key (mode {stat.S_IMODE(mode):04o}): chmod 600 {path}"
    if own is not None and public != own.public_key().public_bytes(*form):
        yield f"{path}: not the key of {identity.certificate}: use the .key that was made with it"


def _role_faults(own: x509.Certificate, roles: tuple[Role, ...]) -> Iterator[str]:
    ask, serve = "ask a router (client authentication)", "serve (server authentication)"
    needed = {ask: Usage.CLIENT_AUTH}
    try:
        member = Member.parse(common_name(own))
    except ValueError as error:
        yield f"its common name contains no role: {error}"
    else:
        if member.role not in roles:
            wanted = " or ".join(role.value for role in roles)
            yield f"for {member.label}, but this program is a {wanted}: issue a certificate for it (truerate pki issue)"
        if member.role.serves:
            needed = {**(needed if member.role is Role.ROUTER else {}), serve: Usage.SERVER_AUTH}
            if not hosts_of(own):
                role = member.role.value
                yield f"it names no host (subject alternative name), so every program refuses this {role}: issue it with --host"
    try:
        usages = list(own.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    except x509.ExtensionNotFound:
        return  # no restriction
    yield from (
        f"its extended key usage does not allow it to {what}: issue a new certificate (truerate pki issue)"
        for what, usage in needed.items()
        if usage not in usages
    )


def _chain_faults(
    identity: Identity, given: Sequence[x509.Certificate], trusted: Sequence[x509.Certificate], now: datetime
) -> Iterator[str]:
    chain, ends = _chain(given, trusted)
    yield from (f"{identity.certificate}: {words}" for one in chain for words in _dates(one, now))
    if all([*_dates(end, now)] for end in ends):
        yield from (f"{identity.ca}: {words}" for end in ends[:1] for words in _dates(end, now))
    if not ends:
        issuer, expected = chain[-1].issuer, trusted[0].subject
        another = " (another authority of the same name; perhaps `pki init` ran twice)" if issuer == expected else ""
        yield (
            f"{identity.certificate}: not signed by {identity.ca} ({common_name(trusted[0])!r}), but by"
            f" {issuer.rfc4514_string()!r}{another}: use that authority's file, or append the"
            " intermediate certificates to the certificate's file"
        )
    yield from (
        f"{identity.ca}: the certificate of {common_name(one)!r} is not an authority's: give the authority's file, ca.pem"
        for one in trusted
        if not _is_authority(one)
    )


def _dates(certificate: x509.Certificate, now: datetime) -> Iterator[str]:
    begins, ends = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now < begins:
        yield (
            f"{common_name(certificate)!r} is not valid before {begins:%Y-%m-%d %H:%M} UTC; this machine's clock"
            f" says {now:%Y-%m-%d %H:%M}: check the clock (timedatectl)"
        )
    if now > ends:
        yield f"{common_name(certificate)!r} expired on {ends:%Y-%m-%d %H:%M} UTC: renew it (truerate pki renew)"


def _chain(
    given: Sequence[x509.Certificate], trusted: Sequence[x509.Certificate]
) -> tuple[list[x509.Certificate], list[x509.Certificate]]:
    """Return the chain upwards from the first given certificate, and the trusted certificates that signed its end.

    The second list is empty if a signer is missing.
    """
    chain, left = [given[0]], list(given[1:])
    while not (ends := [ca for ca in trusted if _signed(chain[-1], ca)]):
        issuer = next((one for one in left if _signed(chain[-1], one)), None)
        if issuer is None:
            break
        left.remove(issuer)
        chain.append(issuer)
    return chain, ends


def _signed(certificate: x509.Certificate, issuer: x509.Certificate) -> bool:
    try:
        certificate.verify_directly_issued_by(issuer)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        return False
    return _is_authority(issuer)


def _is_authority(certificate: x509.Certificate) -> bool:
    try:
        return certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        return False
