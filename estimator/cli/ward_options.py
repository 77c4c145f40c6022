"""Which ward a verb is about, and by which routers, for who has a role there; and who that is."""

import argparse
import getpass
import os

from bridge.bus.routers import Routers
from bridge.cli import ward_options
from bridge.pki.member import Role
from bridge.toml.loader import ConfigError


def ward_of(given: argparse.Namespace, *roles: Role) -> tuple[str, Routers]:
    """The ward's name and its routers, for who has one of the roles (default: who may look)."""
    from estimator.config.schema import Ward  # noqa: PLC0415

    try:
        root = ward_options.ward_of(given, Ward)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return root.ward, root.bus.routers_as(*(roles or (Role.VIEWER, Role.COMMANDER, Role.RECORDER)))


def person() -> str:
    """Who asks, for the audit: the name of the user, or the number where it has none, as in many a container."""
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):
        return f"uid-{os.getuid()}"
