"""Options of a verb that name a ward and its routers."""

import argparse
from pathlib import Path
from typing import TypeVar

from msgspec.structs import replace

from bridge.config.schema import LOCAL, Root, check, check_endpoints, load

R = TypeVar("R", bound=Root)


def add_ward(verb: argparse.ArgumentParser, config: str = "the ward's file: says the ward and the routers") -> None:
    """The options that say it; what its file is for."""
    verb.add_argument("--config", type=Path, help=config)
    verb.add_argument("--ward", metavar="W", help="the ward's name (default: the file's, else 'ward')")
    verb.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help=f"a router (default: the file's, else {LOCAL})"
    )


def ward_of(args: argparse.Namespace, kind: type[R]) -> R:
    """The file, or what it is by default, with the ward and the routers that were said; ValueError if these are none."""
    root = load(args.config, kind) if args.config else kind(ward=args.ward or "ward")
    bus = replace(root.bus, connect=check_endpoints(args.connect, "--connect")) if args.connect else root.bus
    return replace(root, ward=check(args.ward or root.ward, "--ward"), bus=bus)
