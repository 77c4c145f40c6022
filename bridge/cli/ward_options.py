"""Command-line options that select a ward and its routers: --config, --ward, --connect."""

import argparse
from pathlib import Path
from typing import TypeVar

from msgspec.structs import replace

from bridge.config.schema import LOCAL, Root, check, check_endpoints, load

R = TypeVar("R", bound=Root)


def add_ward(
    verb: argparse.ArgumentParser, config: str = "the ward file (TOML): gives the ward's name and the routers"
) -> None:
    """Add the options --config, --ward and --connect, which select a ward and its routers.

    config: help text of --config.
    """
    verb.add_argument("--config", type=Path, help=config)
    verb.add_argument("--ward", metavar="W", help="name of the ward (default: from the ward file, else 'ward')")
    verb.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        help=f"endpoint of a router; repeatable (default: from the ward file, else {LOCAL})",
    )


def ward_of(args: argparse.Namespace, kind: type[R]) -> R:
    """Return the content of the ward file, with the options --ward and --connect in place of its ward and routers.

    Without --config, all settings have their defaults. kind: type of the content, Root or a subclass.
    Raises ConfigError for an invalid file, and ValueError for an invalid option.
    """
    root = load(args.config, kind) if args.config else kind(ward=args.ward or "ward")
    bus = replace(root.bus, connect=check_endpoints(args.connect, "--connect")) if args.connect else root.bus
    return replace(root, ward=check(args.ward or root.ward, "--ward"), bus=bus)
