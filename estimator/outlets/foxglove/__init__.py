"""Outlet for Foxglove: a WebSocket server with a channel for each device.

The module `server` contains the server; docs/foxglove.md describes the outlet.
"""

import argparse
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bridge.pki.member import Role
from bridge.toml.loader import ConfigError

if TYPE_CHECKING:
    from estimator.client import Client

_LOOPBACK = ("127.0.0.1", "localhost", "::1")
PORT = 8765


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Add the options of `truerate outlet foxglove`."""
    verb.add_argument(
        "--host",
        default=_LOOPBACK[0],
        metavar="ADDRESS",
        help="address to listen on; everybody who reaches it sees the ward's data (default: %(default)s)",
    )
    verb.add_argument(
        "--port",
        type=int,
        default=PORT,
        metavar="PORT",
        help="port to listen on; 0: any free port (default: %(default)s)",
    )
    verb.add_argument(
        "--allow-recalibrate",
        action="store_true",
        help="offer the service /recalibrate; on this machine only, and with a commander's certificate if the ward has any",
    )


def roles(given: argparse.Namespace) -> tuple[Role, ...]:
    """Return the roles of which the client certificate needs one; empty if any role with read access suffices.

    Raises ConfigError for an invalid port, and for --allow-recalibrate on an address that other machines can reach.
    """
    if not 0 <= given.port <= 65535:
        raise ConfigError(f"--port is {given.port}: use 1 to 65535, or 0 for any free port")
    if given.allow_recalibrate and given.host not in _LOOPBACK:
        raise ConfigError(
            f"--allow-recalibrate with --host {given.host}: Foxglove has no passwords, so everybody who reaches the port could"
            " recalibrate: omit one of the two options, or use the dashboard, which asks for a password"
        )
    return (Role.COMMANDER,) if given.allow_recalibrate else ()


def serve(client: "Client", devices: Sequence[str] | None, given: argparse.Namespace, stop: threading.Event) -> int:
    """Serve the ward to Foxglove until `stop` is set; returns the exit code 0.

    devices: ids, None for all. given: parsed options. Raises ConfigError if the server cannot listen on the port.
    """
    from estimator.outlets.foxglove.server import FoxgloveOutlet  # noqa: PLC0415 - needs foxglove and rosbags

    with FoxgloveOutlet(client, devices, given.host, given.port, recalibrate=given.allow_recalibrate) as outlet:
        print(f"Foxglove: open a connection to ws://{given.host}:{outlet.port}", flush=True)  # noqa: T201 - a command's output
        while not stop.is_set():
            outlet.round(0.1)
    return 0
