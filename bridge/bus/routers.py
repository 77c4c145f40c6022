"""Endpoints of routers, and the certificate that is shown to them."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import overload

from bridge.pki.certificate_files import Identity, Validity

#: protocols of zenoh endpoints that are encrypted, and know who is at the other end
SECURED = ("tls", "quic")


def secured(endpoint: str) -> bool:
    """Whether an endpoint needs certificates."""
    return endpoint.partition("/")[0] in SECURED


@dataclass(frozen=True, slots=True)
class Routers(Sequence[str]):
    """Endpoints, the first that answers is used; with an identity where they are `tls/...`."""

    endpoints: tuple[str, ...]
    identity: Identity | None = None

    @classmethod
    def of(cls, endpoints: Sequence[str]) -> "Routers":
        """As they are, or plain endpoints without an identity."""
        return endpoints if isinstance(endpoints, Routers) else cls(tuple(endpoints))

    def faults(self) -> list[str]:
        """What of the identity would make every router refuse us, or us every router, now."""
        if self.identity is None:
            return []
        from bridge.pki.certificate_checks import faults  # noqa: PLC0415 - only who has certificates waits until they can be read

        return faults(self.identity, datetime.now(UTC))

    def lasts(self) -> Validity | None:
        """How long the certificate does, or one above it that ends before; None where none is asked for, or none can be read."""
        if self.identity is None:
            return None
        from bridge.pki.certificate_checks import lasts  # noqa: PLC0415 - as above

        try:
            return lasts(self.identity)
        except ValueError:
            return None

    def soon(self) -> list[str]:
        """That the certificate ends within days, while there is time to renew it."""
        lasts = self.lasts()
        if self.identity is None or lasts is None or not lasts.soon <= datetime.now(UTC) < lasts.ends:
            return []
        ending = f"ends on {lasts.ends:%Y-%m-%d %H:%M} UTC, and is of no use from then on"
        return [f"{self.identity.certificate}: {ending}: renew it (truerate pki renew --soon)"]

    def why_away(self) -> list[str]:
        """Why no router may let us in, for whom it was there before."""
        if self.identity is None:
            return []
        return self.faults() or [
            f"it does not run, is not reached, or does not let in {self.identity.certificate}, which may have been revoked"
        ]

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[str, ...]: ...
    def __getitem__(self, index: int | slice) -> str | tuple[str, ...]:
        return self.endpoints[index]

    def __len__(self) -> int:
        return len(self.endpoints)
