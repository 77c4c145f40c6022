"""Self-test of a router's access rules: one allowed and one forbidden liveliness token show if the rules are in force.

The test is needed because zenoh denies silently.
"""

import threading
from collections.abc import Callable, Sequence

from bridge.bus.contract import Bus, BusError
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.wire import keys

WAIT_S = 2.0
_AFTER_S = 0.1  # each token is reported by a separate thread, so the order may change
_NOBODY = "nobody"


def self_test(
    bus: Bus, routers: Routers, ward: str, open_bus: Callable[[Sequence[str]], Bus] = ZenohBus, wait_s: float = WAIT_S
) -> list[str]:
    """Test if a running router enforces its access rules; return the faults as sentences.

    Returns [] if there are no faults, or without certificates, because then there are no rules.
    Method: open_bus opens a second session, which declares two liveliness tokens: first one that the
    access rules forbid, then this program's own token. `bus` must see only the second token.
    bus: this program's open session. routers: router endpoints and this program's certificate. ward: id of the ward.
    wait_s: seconds to wait for the allowed token.
    Raises ValueError if the certificate is unreadable or names no role.
    """
    if routers.identity is None:
        return []
    from bridge.pki.certificate_checks import member_of  # noqa: PLC0415 - import `cryptography` only if certificates are used

    member = member_of(routers.identity)
    own = keys.build(ward, "alive/probe", role=member.role.value, name=member.name)
    forbidden = keys.build(ward, "alive/probe", role=_NOBODY, name=_NOBODY)
    seen = {own: threading.Event(), forbidden: threading.Event()}

    def on_change(key: str, alive: bool) -> None:  # noqa: FBT001 - the bus's contract
        if alive:
            seen[key].set()

    where = ", ".join(routers)
    watches = [bus.watch_alive(key, on_change) for key in seen]
    try:
        with open_bus(routers) as other:
            other.declare_alive(forbidden)
            other.declare_alive(own)
            if seen[own].wait(wait_s):
                seen[forbidden].wait(_AFTER_S)
    except BusError as error:
        return [f"the access rules of the router at {where} could not be tested as {member.common_name}: {error}"]
    finally:
        for watch in watches:
            watch.close()
    wrong = []
    if not seen[own].is_set():
        wrong.append(
            f"the router at {where} drops all messages to and from {member.common_name} in ward {ward}: its rules lack this name,"
            " or the name was revoked. Write the router's file again (truerate pki router) and restart the router"
        )
    if seen[forbidden].is_set():
        wrong.append(
            f"the router at {where} has no access rules: every certificate may do everything in ward {ward}. Start the router"
            " with a file that `truerate pki router` wrote"
        )
    return wrong
