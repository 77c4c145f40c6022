"""Checks of a ward's routers: reachability and certificate."""

from collections.abc import Callable, Iterator, Sequence

from bridge.bus.contract import Bus, BusError
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.diagnose.finding import Finding, Level, ok, trouble, warning


def certificate(routers: Routers) -> Iterator[Finding]:
    """Whether the certificate is valid, or expires soon."""
    lasts = routers.lasts()
    if wrong := routers.faults():
        yield trouble(
            "certificate",
            "; ".join(wrong),
            "correct this first: no router accepts this certificate; see docs/security.md",
        )
    elif soon := routers.soon():
        yield warning(
            "certificate", "; ".join(soon), "on the authority's machine; then copy the .pem here, over the old file"
        )
    elif routers.identity and lasts:
        yield ok("certificate", f"{routers.identity.certificate}, until {lasts.ends:%Y-%m-%d}")


def router(endpoints: Sequence[str], open_bus: Callable[[Sequence[str]], Bus] = ZenohBus) -> list[Finding]:
    """Connect to each router and disconnect again; the spare router has to answer too."""
    routers = Routers.of(endpoints)
    reached, silent = list[str](), dict[str, str]()
    for endpoint in routers:
        try:
            open_bus(Routers((endpoint,), routers.identity)).close()
            reached.append(endpoint)
        except BusError as error:
            silent[endpoint] = str(error)
    do = "start `truerate router` or zenohd on the router's machine, or correct `connect` in [bus]"
    worse = warning if reached else trouble
    found = [worse("router", words, do) for words in silent.values()]
    return [*([ok("router", f"answers at {', '.join(reached)}")] if reached else []), *found]


def answers(findings: Sequence[Finding]) -> bool:
    """Whether one of the routers answered."""
    return any(finding.level is Level.OK for finding in findings)
