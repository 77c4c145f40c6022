"""A certificate and what is above it, up to an authority that is trusted: whether zenoh's TLS takes it, in words. Pure.

zenoh verifies by rustls and ring, which take less than OpenSSL does: P-256, P-384, Ed25519 and RSA, no `any` extended usage.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from cryptography.hazmat.primitives.asymmetric.types import CertificatePublicKeyTypes
from cryptography.x509.oid import ExtensionOID as Extension
from cryptography.x509.oid import NameOID
from cryptography.x509.oid import SignatureAlgorithmOID as By

#: who signs for one member alone is called so, and then as that
ISSUER_OF = "issuer of "
_CURVES, _RSA_BITS = ("secp256r1", "secp384r1"), (2048, 8192)
#: of a key that signs by ring
_OWN_RSA_BITS, _OWN_RSA_EXPONENT = (2048, 3072, 4096), 65537
#: an extension that must be understood and is none of these makes webpki refuse a certificate
_UNDERSTOOD = {
    *(Extension.KEY_USAGE, Extension.EXTENDED_KEY_USAGE, Extension.BASIC_CONSTRAINTS, Extension.NAME_CONSTRAINTS),
    *(Extension.SUBJECT_ALTERNATIVE_NAME, Extension.CRL_DISTRIBUTION_POINTS),
}
_SIGNED = {
    *(By.ECDSA_WITH_SHA256, By.ECDSA_WITH_SHA384, By.ED25519),
    *(By.RSA_WITH_SHA256, By.RSA_WITH_SHA384, By.RSA_WITH_SHA512, By.RSASSA_PSS),
}


@dataclass(frozen=True, slots=True)
class Chain:
    """The holder's own, those in between that its file brings along, and who of the trusted has signed the last of them."""

    own: x509.Certificate
    between: Sequence[x509.Certificate]
    ends: Sequence[x509.Certificate]

    @classmethod
    def of(cls, given: Sequence[x509.Certificate], trusted: Sequence[x509.Certificate]) -> "Chain":
        """From the first of those given up; `ends` is empty where a signer is missing."""
        own, *left = given
        between: list[x509.Certificate] = []
        at = own
        while not (ends := [ca for ca in trusted if _signed(at, ca)]):
            issuer = next((one for one in left if _signed(at, one)), None)
            if issuer is None:
                break
            left.remove(issuer)
            between.append(issuer)
            at = issuer
        return cls(own, between, ends)

    @property
    def last(self) -> x509.Certificate:
        """Whose signer is trusted, or missing."""
        return self.between[-1] if self.between else self.own

    def end_faults(self, now: datetime) -> list[str]:
        """What is wrong with who is trusted: nothing, where one of them is in order."""
        found = [[*filter(None, [unusable(key_of(end))]), *dates(end, now)] for end in self.ends]
        return min(found, key=len, default=[])

    def faults(self, now: datetime, needed: Mapping[str, x509.ObjectIdentifier]) -> Iterator[str]:
        """What is wrong with those of the certificate's file; needed: usages, by what they are for."""
        if is_authority(self.own):
            yield "it is an authority's, which signs others; nobody takes one for a holder's own"
        for below, one in enumerate(self.between):
            yield from (f"{_named(one)}{words}" for words in dates(one, now))
            if (most := _most_below(one)) is not None and below > most:
                yield f"{_named(one)}at most {most} others may be below it, and {below} are"
        for one in (self.own, *self.between):
            named = "" if one is self.own else _named(one)
            if words := unusable(key_of(one), own=one is self.own):
                yield f"{named}{words}"
            if strange := [found.oid for found in one.extensions if found.critical and found.oid not in _UNDERSTOOD]:
                words = ", ".join(oid.dotted_string for oid in strange)
                yield f"{named}an extension that is marked critical, {words}, which zenoh does not know: have it made without"
            if one.version is not x509.Version.v3:
                yield f"{named}of an X.509 before version 3, which nobody takes any more"
            if one.signature_algorithm_oid not in _SIGNED:
                yield f"{named}signed otherwise than zenoh takes: by ECDSA or RSA with SHA-256 or SHA-384, or by Ed25519"
            usages = _usages(one)
            yield from (
                f"{named}its extended key usage does not let it {what}"
                for what, usage in needed.items()
                if usages is not None and usage not in usages
            )


def dates(certificate: x509.Certificate, now: datetime) -> Iterator[str]:
    """Why it is not valid now."""
    begins, ends = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now < begins:
        yield (
            f"not valid before {begins:%Y-%m-%d %H:%M} UTC; here it is {now:%Y-%m-%d %H:%M}: is this machine's clock right?"
        )
    if now > ends:
        yield f"expired on {ends:%Y-%m-%d %H:%M} UTC: renew it (truerate pki renew)"


def common_name(certificate: x509.Certificate) -> str:
    """Empty where it has none."""
    found = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(found[0].value) if found else ""


def unusable(public: object, *, own: bool = False) -> str:
    """Why zenoh cannot verify by a public key, nor sign by its private one where that is its own; empty where it can."""
    match public:
        case ec.EllipticCurvePublicKey() if public.curve.name in _CURVES:
            return ""
        case rsa.RSAPublicKey() if _RSA_BITS[0] <= public.key_size <= _RSA_BITS[1] and not own:
            return ""
        case rsa.RSAPublicKey() if public.key_size in _OWN_RSA_BITS and public.public_numbers().e >= _OWN_RSA_EXPONENT:
            return ""
        case ed25519.Ed25519PublicKey():
            return ""
        case ec.EllipticCurvePublicKey():
            kind = f"on the curve {public.curve.name}"
        case rsa.RSAPublicKey():
            kind = f"of RSA with {public.key_size} bits, exponent {public.public_numbers().e}"
        case _:
            kind = "of another kind"
    of_rsa = f"{', '.join(map(str, _OWN_RSA_BITS))} bits, exponent {_OWN_RSA_EXPONENT}" if own else "2048 to 8192 bits"
    return f"a key {kind}, which zenoh cannot use: P-256, P-384, Ed25519, or RSA with {of_rsa}"


def _named(one: x509.Certificate) -> str:
    return f"{common_name(one)!r}, in between: "


def _signed(certificate: x509.Certificate, issuer: x509.Certificate) -> bool:
    try:
        certificate.verify_directly_issued_by(issuer)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        return False
    return is_authority(issuer)


def is_authority(certificate: x509.Certificate) -> bool:
    """Whether it may sign others."""
    try:
        return certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        return False


def _most_below(authority: x509.Certificate) -> int | None:
    return authority.extensions.get_extension_for_class(x509.BasicConstraints).value.path_length


def key_of(certificate: x509.Certificate) -> CertificatePublicKeyTypes | None:
    """Its public key; None where it is of a kind that is not known here."""
    try:
        return certificate.public_key()
    except UnsupportedAlgorithm:
        return None


def _usages(certificate: x509.Certificate) -> list[x509.ObjectIdentifier] | None:
    """What it may be used for; None: for all."""
    try:
        return list(certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    except x509.ExtensionNotFound:
        return None
