"""Router endpoints, together with the certificate that this program shows to the routers."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import overload

from bridge.pki.certificate_files import Identity, Validity

#: protocols of zenoh endpoints with encryption and certificates
SECURED = ("tls", "quic")


def secured(endpoint: str) -> bool:
    """Return True if a zenoh endpoint uses TLS or QUIC and therefore needs certificates."""
    return endpoint.partition("/")[0] in SECURED


@dataclass(frozen=True, slots=True)
class Routers(Sequence[str]):
    """Router endpoints in order of preference, as a sequence of str, with the certificate files for `tls/...` endpoints.

    identity: paths of the certificate files; None without certificates.
    """

    endpoints: tuple[str, ...]
    identity: Identity | None = None

    @classmethod
    def of(cls, endpoints: Sequence[str]) -> "Routers":
        """Convert endpoints to Routers: Routers are returned unchanged; other sequences get no certificate."""
        return endpoints if isinstance(endpoints, Routers) else cls(tuple(endpoints))

    def faults(self) -> list[str]:
        """Return the faults of the certificate that would make a TLS connection fail now, as sentences; [] if none."""
        if self.identity is None:
            return []
        from bridge.pki.certificate_checks import faults  # noqa: PLC0415 - import `cryptography` only if certificates are used

        return faults(self.identity, datetime.now(UTC))

    def lasts(self) -> Validity | None:
        """Return the validity period of the certificate that expires first in this program's certificate chain.

        None without certificates, or if a file is unreadable.
        """
        if self.identity is None:
            return None
        from bridge.pki.certificate_checks import lasts  # noqa: PLC0415 - as above

        try:
            return lasts(self.identity)
        except ValueError:
            return None

    def soon(self) -> list[str]:
        """Return one warning, as a sentence, while the certificate is due for renewal and has not expired; else []."""
        lasts = self.lasts()
        if self.identity is None or lasts is None or not lasts.soon <= datetime.now(UTC) < lasts.ends:
            return []
        ending = f"expires on {lasts.ends:%Y-%m-%d %H:%M} UTC"
        return [f"{self.identity.certificate}: {ending}: renew it (truerate pki renew --soon)"]

    def why_away(self) -> list[str]:
        """Return why the connection to every router may have been lost: faults of the certificate, else other causes.

        Each reason is a text. [] without a certificate.
        """
        if self.identity is None:
            return []
        return self.faults() or [
            f"the router does not run, is unreachable, or refuses {self.identity.certificate}, which may have been revoked"
        ]

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[str, ...]: ...
    def __getitem__(self, index: int | slice) -> str | tuple[str, ...]:
        return self.endpoints[index]

    def __len__(self) -> int:
        return len(self.endpoints)
