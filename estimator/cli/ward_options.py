"""Finds a verb's ward and routers from its options, and the person who runs it."""

import argparse
import getpass
import os
import sys

from bridge.bus.routers import Routers
from bridge.cli import ward_options
from bridge.pki.member import Role
from bridge.toml.loader import ConfigError


def ward_of(given: argparse.Namespace, *roles: Role) -> tuple[str, Routers]:
    """Return the ward's name and its routers, as the options and the ward file say.

    roles: one of these is needed; by default the roles that may look. Raises ConfigError, also if the file's
    certificate has another role.
    """
    from estimator.config.schema import Ward  # noqa: PLC0415

    try:
        root = ward_options.ward_of(given, Ward)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return root.ward, root.bus.routers_as(*(roles or (Role.VIEWER, Role.COMMANDER, Role.RECORDER)))


def listening(given: argparse.Namespace, ward: str) -> None:
    """Print on standard error which ward is listened to, since the answer takes some seconds."""
    default = "" if given.config or given.ward else " (the default; name another with --config or --ward)"
    print(f"listening to ward {ward}{default} …", file=sys.stderr)


def person() -> str:
    """Return the user's name for the audit; the user's number if there is no name, as in many containers."""
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        name = "unknown"
        if sys.platform != "win32":
            name = f"uid-{os.getuid()}"
        return name
