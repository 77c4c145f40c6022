"""Connect a subscriber to a ward's router and report what its certificate does not permit it to receive."""

import logging
import threading
from collections.abc import Sequence

from bridge.bus.access_self_test import self_test
from bridge.bus.contract import Bus
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.pki.member import Role

#: log "looking for a router" when no router has answered for this long, s
LOOKED_S = 1.0
#: certificate roles that may receive a ward's messages
SUBSCRIBERS = (Role.VIEWER, Role.COMMANDER, Role.RECORDER, Role.ROS2)

log = logging.getLogger(__name__)


def connected(endpoints: Sequence[str]) -> ZenohBus:
    """Connect to a router at one of `endpoints`; logs a warning if that takes longer than LOOKED_S.

    Returns the open bus session. Raises BusError when no router answers.
    """
    told = threading.Timer(LOOKED_S, log.warning, ("looking for a router at %s", ", ".join(endpoints)))
    told.daemon = True
    told.start()
    try:
        return ZenohBus(endpoints)
    finally:
        told.cancel()


def denied(bus: Bus, endpoints: Sequence[str], ward: str) -> tuple[str, ...]:
    """Reasons why no message of a ward may arrive although a router is connected; empty if no fault is known.

    Checks the role of this program's certificate and what the routers let it receive. Each reason is also logged.
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
        f"the certificate is for {member.label}, which may receive little or nothing: use a certificate for {fit}",
    )
    if member.role in SUBSCRIBERS:
        found = tuple(self_test(bus, routers, ward))
    for words in found:
        log.error("%s", words)
    return found
