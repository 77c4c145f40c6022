"""Checks of a ward's routers and certificates for `truerate doctor`: if each router answers, and if a certificate expires."""

from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from bridge.bus.contract import Bus, BusError
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.diagnose.finding import Finding, Level, ok, trouble, warning
from bridge.pki.certificate_checks import certificates, lasts_of

_RENEW = "on the authority's machine: truerate pki renew --soon; then copy the .pem here, over the old file"


def renewal(path: Path | None, ward: str) -> str:
    """Return in words how to renew a certificate of a ward. path: the ward file; None if unknown.

    The text is a command `truerate init ...` if the ward file's folder holds the authority that `truerate init`
    created. Otherwise, it says to renew the certificate on the authority's machine and to copy it.
    """
    if path is None or not (path.parent / "authority").is_dir():
        return _RENEW
    folder = "" if path.parent == Path("/etc/truerate") else f" --folder {path.parent}"
    return f"sudo truerate init {ward} --no-scan{folder}"


def certificate(routers: Routers, renew: str = _RENEW) -> Iterator[Finding]:
    """Check if this program's certificate is valid, or expires soon. Yields no finding without certificates.

    routers: router endpoints with the certificate to check. renew: advice if it expires soon.
    """
    lasts = routers.lasts()
    if wrong := routers.faults():
        yield trouble(
            "certificate",
            "; ".join(wrong),
            "correct this first: no router accepts this certificate; see docs/security.md",
        )
    elif soon := routers.soon():
        yield warning("certificate", "; ".join(soon), renew)
    elif routers.identity and lasts:
        yield ok("certificate", f"{routers.identity.certificate}, until {lasts.ends:%Y-%m-%d}")


def page_certificate(file: str, renew: str) -> Finding:
    """Check if the certificate that the dashboard shows to browsers is valid, or expires soon.

    file: path of the certificate. renew: advice if it expires soon or has expired.
    """
    try:
        lasts = lasts_of(certificates(file)[0])
    except ValueError as error:
        return trouble("page certificate", str(error), "correct `certificate` in [dashboard], or copy the file there")
    now, ends = datetime.now(UTC), f"{lasts.ends:%Y-%m-%d %H:%M} UTC"
    if now < lasts.soon:
        return ok("page certificate", f"{file}, until {ends}")
    if now < lasts.ends:
        return warning("page certificate", f"{file} expires on {ends}", renew)
    return trouble("page certificate", f"{file} expired on {ends}: browsers refuse the page", renew)


def router(endpoints: Sequence[str], open_bus: Callable[[Sequence[str]], Bus] = ZenohBus) -> list[Finding]:
    """Check if each router endpoint answers, by connecting and disconnecting again.

    Returns one finding for each endpoint without answer: a warning if another endpoint answers, else trouble. The
    endpoints that answer share one OK finding.
    open_bus: connects to one of the given endpoints; raises BusError if none answers.
    """
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
    """Return True if at least one router answered. findings: result of `router`."""
    return any(finding.level is Level.OK for finding in findings)
