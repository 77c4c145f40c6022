"""Connects a subscriber to a ward's router, and tells what its certificate does not let it hear."""

import logging
import threading
from collections.abc import Sequence

from bridge.bus.access_self_test import self_test
from bridge.bus.contract import Bus
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.pki.member import Role

#: a router that does not answer for so long is said to be looked for, s
LOOKED_S = 1.0
#: whose certificates let them hear what a ward says
SUBSCRIBERS = (Role.VIEWER, Role.COMMANDER, Role.RECORDER)

log = logging.getLogger(__name__)


def connected(endpoints: Sequence[str]) -> ZenohBus:
    """A session with a router; the log says that it is looked for where that takes its time."""
    told = threading.Timer(LOOKED_S, log.warning, ("looking for a router at %s", ", ".join(endpoints)))
    told.daemon = True
    told.start()
    try:
        return ZenohBus(endpoints)
    finally:
        told.cancel()


def denied(bus: Bus, endpoints: Sequence[str], ward: str) -> tuple[str, ...]:
    """Why nothing may come although a router is there, also in the log; empty where nothing is known to be wrong."""
    routers = Routers.of(endpoints)
    if routers.identity is None:
        return ()
    for words in routers.soon():
        log.warning("%s", words)
    from bridge.pki.certificate_checks import member_of  # noqa: PLC0415 - only who has certificates waits until they can be read

    member = member_of(routers.identity)
    fit = ", ".join(role.value for role in SUBSCRIBERS)
    found: tuple[str, ...] = (
        f"the certificate is for {member.label}, which hears little or nothing; who subscribes is one of {fit}",
    )
    if member.role in SUBSCRIBERS:
        found = tuple(self_test(bus, routers, ward))
    for words in found:
        log.error("%s", words)
    return found
