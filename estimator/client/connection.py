"""Check of a subscriber's certificate: reports the messages that it does not permit the program to receive."""

import logging
from collections.abc import Sequence

from bridge.bus.access_self_test import self_test
from bridge.bus.contract import Bus
from bridge.bus.routers import Routers
from bridge.pki.member import Role

#: certificate roles that may receive a ward's messages
SUBSCRIBERS = (Role.VIEWER, Role.COMMANDER, Role.RECORDER, Role.ROS2)

log = logging.getLogger(__name__)


def denied(bus: Bus, endpoints: Sequence[str], ward: str) -> tuple[str, ...]:
    """Return access faults because of which messages of a ward do not arrive although a router is connected.

    Each fault is a sentence for the user; empty if none is found.
    Checks the role of this program's certificate, and the messages that the routers deliver to it. Each fault is also
    logged. bus: an open session. endpoints: addresses of the routers.
    """
    routers = Routers.of(endpoints)
    if routers.identity is None:
        return ()
    for words in routers.soon():
        log.warning("%s", words)
    from bridge.pki.certificate_checks import member_of  # noqa: PLC0415 - slow import, needed only with certificates

    member = member_of(routers.identity)
    fit = ", ".join(role.value for role in SUBSCRIBERS)
    found: tuple[str, ...] = (
        f"the certificate is for {member.label}, which may receive little or no data: use a certificate of role {fit}",
    )
    if member.role in SUBSCRIBERS:
        found = tuple(self_test(bus, routers, ward))
    for words in found:
        log.error("%s", words)
    return found
