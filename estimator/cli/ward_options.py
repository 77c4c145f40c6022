"""Options that name a ward: finds the ward, its routers, and the person who runs the command."""

import argparse
import getpass
import os
import sys

from bridge.bus.routers import Routers
from bridge.cli import ward_options
from bridge.pki.member import Role
from bridge.toml.loader import ConfigError


def ward_of(given: argparse.Namespace, *roles: Role) -> tuple[str, Routers]:
    """Return the ward's name and its routers, from the options and the ward file.

    roles: accepted roles of this program's certificate; by default the roles that may receive messages.
    Raises ConfigError for an invalid ward file, and for a certificate with another role.
    """
    from estimator.config.schema import Ward  # noqa: PLC0415

    try:
        root = ward_options.ward_of(given, Ward)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return root.ward, root.bus.routers_as(*(roles or (Role.VIEWER, Role.COMMANDER, Role.RECORDER)))


def listening(given: argparse.Namespace, ward: str) -> None:
    """Print `listening to ward NAME` to standard error, because the answer of the ward takes some seconds."""
    default = "" if given.config or given.ward else " (the default; name another with --config or --ward)"
    print(f"listening to ward {ward}{default} …", file=sys.stderr)


def person() -> str:
    """Return the name of the user who runs this program, for the audit table of commands.

    The result is `uid-NUMBER` if the user has no name, as in many containers.
    """
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        name = "unknown"
        if sys.platform != "win32":
            name = f"uid-{os.getuid()}"
        return name
