"""Where routers are, and who we are to them."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import overload

from bridge.pki.identity import Identity, faults

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
        return faults(self.identity, datetime.now(UTC)) if self.identity else []

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[str, ...]: ...
    def __getitem__(self, index: int | slice) -> str | tuple[str, ...]:
        return self.endpoints[index]

    def __len__(self) -> int:
        return len(self.endpoints)
