"""Member of a ward: role and name of a program, as in the common name of its certificate. No I/O."""

from dataclasses import dataclass
from enum import Enum
from typing import Self

from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal


class Role(Enum):
    """Role of a certificate's holder, which determines its access rights. The value is part of common names and file names.

    VIEWER: reads results. COMMANDER: may also start recalibrations. ROS2: publishes samples as ROS 2 messages. PAGE:
    the dashboard's web server, whose certificate is for browsers. `bus.access_rules` defines the rights of each role.
    """

    BRIDGE = "bridge"
    ESTIMATOR = "estimator"
    VIEWER = "viewer"
    COMMANDER = "commander"
    RECORDER = "recorder"
    ROS2 = "ros2"
    ROUTER = "router"
    PAGE = "page"

    @property
    def serves(self) -> bool:
        """True if other programs connect to the holder, by the hosts in its certificate.

        This is so for a router, and for the dashboard's web server (PAGE).
        """
        return self in (Role.ROUTER, Role.PAGE)


@dataclass(frozen=True, slots=True)
class Member:
    """Holder of a certificate: role, name and generation.

    generation: 1 at first, and one more after each revocation. zenoh cannot read lists of revoked certificates; its
    access rules name common names. So a revoked common name is never used again. Its holder gets the next generation of
    the name, and the rules name only that generation.
    """

    role: Role
    name: str
    generation: int = 1

    @property
    def common_name(self) -> str:
        """Common name in the certificate and in router rules: `bridge:bridge-1`, or `bridge:bridge-1:2` in generation 2."""
        return f"{self.label}:{self.generation}" if self.generation > 1 else self.label

    @property
    def label(self) -> str:
        """Role and name, as on a command line: `bridge:bridge-1`."""
        return f"{self.role.value}:{self.name}"

    @property
    def file(self) -> str:
        """Name of the member's certificate and key files, without suffix: `bridge.bridge-1`."""
        return self.common_name.replace(":", ".")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a common name, such as `bridge:bridge-1` or `bridge:bridge-1:2`.

        Raises ValueError, with the expected format, for any other text.
        """
        role, _, rest = text.partition(":")
        name, _, generation = rest.partition(":")
        roles = [known.value for known in Role]
        if role not in roles:
            raise ValueError(
                f"{text!r} is not ROLE:NAME: write for example 'bridge:bridge-1'; roles: {', '.join(roles)}"
            )
        try:
            check_id(name, f"the name in {text!r}")
        except Refusal as refusal:
            raise ValueError(refusal.detail) from None
        made = cls(Role(role), name, int(generation) if generation.isascii() and generation.isdecimal() else 1)
        if made.common_name != text:
            raise ValueError(
                f"{text!r} has no valid generation: end it in ':2' or a higher number; the first certificate has no number"
            )
        return made
