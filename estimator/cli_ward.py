"""Which ward a verb is about, and by which routers: from its file, and from what was said beside it."""

import argparse
from pathlib import Path

from msgspec.structs import replace

from bridge.bus.routers import Routers
from bridge.config import LOCAL, Bus, ConfigError, check_endpoints, load
from bridge.pki.member import Role
from bridge.wire.keys import check_id


def ward_of(given: argparse.Namespace, *roles: Role) -> tuple[str, Routers]:
    """The ward's name and its routers, for who has one of the roles (default: who may look)."""
    from estimator.config import Ward  # noqa: PLC0415

    file = load(given.config, Ward) if given.config else None
    ward = check_id(given.ward or (file.ward if file else "ward"), "ward")
    bus = file.bus if file else Bus()
    try:
        if given.connect:
            bus = replace(bus, connect=check_endpoints(tuple(given.connect), "--connect"))
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return ward, bus.routers_as(*(roles or (Role.VIEWER, Role.COMMANDER, Role.RECORDER)))


def add_ward(verb: argparse.ArgumentParser) -> None:
    """The options that say which ward is meant."""
    verb.add_argument("--config", type=Path, help="the ward's file: says the ward and the routers")
    verb.add_argument("--ward", help="the ward's name (default: the file's, else 'ward')")
    verb.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help=f"a router (default: the file's, else {LOCAL})"
    )
