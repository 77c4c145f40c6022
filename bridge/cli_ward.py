"""Which ward a verb of the bridge is about, and by which routers: from its file, and from what was said beside it."""

import argparse
from pathlib import Path

from msgspec.structs import replace

from bridge.config import LOCAL, Root, check, check_endpoints, load


def add_ward(verb: argparse.ArgumentParser, config: str = "take ward and router from this file") -> None:
    """The options that say it; what its file is for."""
    verb.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help=f"a router (default: that of --config, else {LOCAL})"
    )
    verb.add_argument("--ward", metavar="W", help="the ward's name (default: that of --config, else 'ward')")
    verb.add_argument("--config", type=Path, help=config)


def ward_of(args: argparse.Namespace) -> Root:
    """The file, or what it is by default, with the ward and the routers that were said; ValueError if these are none."""
    root = load(args.config, Root) if args.config else Root(ward=args.ward or "ward")
    bus = replace(root.bus, connect=check_endpoints(args.connect, "--connect")) if args.connect else root.bus
    return replace(root, ward=check(args.ward or root.ward, "--ward"), bus=bus)
