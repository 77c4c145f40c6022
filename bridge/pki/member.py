"""The role and the name in a certificate's common name. Pure."""

from dataclasses import dataclass
from enum import Enum
from typing import Self

from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal


class Role(Enum):
    """What its holder may do; the value is what stands in a common name and in file names."""

    BRIDGE = "bridge"
    ESTIMATOR = "estimator"
    VIEWER = "viewer"
    COMMANDER = "commander"
    RECORDER = "recorder"
    ROUTER = "router"


@dataclass(frozen=True, slots=True)
class Member:
    """One holder of a certificate.

    zenoh cannot read lists of revoked certificates: its access rules know common names. So a name that was revoked is never
    used again; its holder goes on with the next generation of it, and the rules name only that one.
    """

    role: Role
    name: str
    generation: int = 1

    @property
    def common_name(self) -> str:
        """As in the certificate, and in the router's rules: `bridge:bridge-1`, later `bridge:bridge-1:2`."""
        return f"{self.label}:{self.generation}" if self.generation > 1 else self.label

    @property
    def label(self) -> str:
        """Role and name, as they are given on a command line."""
        return f"{self.role.value}:{self.name}"

    @property
    def file(self) -> str:
        """What its files are called, without their ending."""
        return self.common_name.replace(":", ".")

    @classmethod
    def parse(cls, text: str) -> Self:
        """From a common name; ValueError says what one looks like."""
        role, _, rest = text.partition(":")
        name, colon, generation = rest.partition(":")
        roles = [known.value for known in Role]
        if role not in roles:
            raise ValueError(
                f"{text!r} is no role and name; one looks like 'bridge:bridge-1'; roles: {', '.join(roles)}"
            )
        try:
            check_id(name, f"the name in {text!r}")
        except Refusal as refusal:
            raise ValueError(refusal.detail) from None
        made = cls(Role(role), name, int(generation) if generation.isascii() and generation.isdecimal() else 1)
        if made.common_name != text:
            raise ValueError(f"{text!r}: {colon + generation!r} is no generation; the second of a name ends in ':2'")
        return made
