"""Outlet to the Lab Streaming Layer (LSL): streams of each device, and one stream of markers (docs/lsl.md).

Start reading at `add_arguments` and `serve`. `service` moves data, converts sample times to LSL's clock, and writes
markers. `streams` makes streams with their metadata.
"""

import argparse
import logging
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bridge.pki.member import Role
from bridge.toml.loader import ConfigError

if TYPE_CHECKING:
    from estimator.client import Client

KINDS = ("orientation", "quality", "raw")
_log = logging.getLogger(__name__)


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Add the options of `truerate outlet lsl`."""
    verb.add_argument(
        "--with",
        dest="kinds",
        action="append",
        choices=KINDS,
        metavar="STREAM",
        help=f"another stream of each device beside its corrected rates: {', '.join(KINDS)}; repeatable",
    )


def roles(given: argparse.Namespace) -> tuple[Role, ...]:
    """Return the roles of which the client certificate needs one to receive the requested streams.

    Empty if any role with read access suffices.
    """
    return (Role.COMMANDER, Role.RECORDER) if "raw" in (given.kinds or ()) else ()


def serve(client: "Client", devices: Sequence[str] | None, given: argparse.Namespace, stop: threading.Event) -> int:
    """Copy corrected rates and the requested streams to LSL until `stop` is set; returns the exit code 0.

    devices: ids, None for all. given: parsed options. Raises ConfigError if liblsl is missing.
    """
    try:
        from estimator.outlets.lsl.service import LslOutlet  # noqa: PLC0415 - optional extra
    except (RuntimeError, OSError) as error:  # pylsl is there, but its wheel for this platform has no liblsl
        raise ConfigError(
            "pylsl finds no liblsl on this machine: install it from https://github.com/sccn/liblsl/releases"
        ) from error
    _log.warning("LSL has no encryption and no passwords: every machine in this network can read the streams")
    LslOutlet(client, devices, frozenset(given.kinds or ())).run(stop)
    return 0
