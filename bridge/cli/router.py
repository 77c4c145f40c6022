"""Command-line verb `truerate router`: runs a zenoh router with the settings of a ward file or of a zenoh configuration file."""

import argparse
import logging
from datetime import UTC, datetime
from pathlib import Path

from bridge.bus import router_check
from bridge.bus.contract import BusError
from bridge.bus.embedded_router import Router
from bridge.bus.router_check import RouterFile
from bridge.bus.routers import Routers
from bridge.cli.parser import Verbs, add_guarded
from bridge.config import router_cross_checks
from bridge.config.schema import LOCAL, ConfigError, Root, check_endpoints, load
from bridge.pki.certificate_checks import faults
from bridge.pki.member import Role
from bridge.runtime.service_manager import supervised
from bridge.runtime.signals import stopped_by_signal
from bridge.wire import keys

_DONE = 0
#: interval of the warning that the certificate ends soon
_SELDOM_S = 12 * 3600.0
_ENDS = "this router's certificate expires on %s: renew it (truerate pki renew), then restart the router"
_log = logging.getLogger(__name__)


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `router`, which runs a zenoh router, to the command."""
    example = f"truerate router --listen {LOCAL}"
    verb = add_guarded(verbs, "router", router, "run a zenoh router on this machine until stopped (Ctrl-C)", example)
    verb.add_argument(
        "--listen", action="append", metavar="ENDPOINT", help=f"endpoint to listen on; repeatable (default: {LOCAL})"
    )
    verb.add_argument(
        "--config",
        type=Path,
        help="the ward file (TOML) with the endpoints, or a zenohd file (.json5) written by `truerate pki router`",
    )


def router(args: argparse.Namespace) -> int:
    """Run a zenoh router until Ctrl-C or SIGTERM (`truerate router`); return exit code 0.

    Raises ValueError for an invalid argument, ConfigError for an unusable file or certificate, and BusError if the
    router cannot listen.
    """
    written = args.config and args.config.suffix in (".json5", ".json")
    file = _looked_through(args.config) if written else None
    lasts = Routers(file.listen, file.identity).lasts() if file else None
    with stopped_by_signal() as stop, _listening_router(args, written=bool(written)) as running, supervised():
        _log.info("router: listening on %s", ", ".join(running.listen))
        while True:  # checks the certificate of the start: the router does not load a renewed one
            if lasts and datetime.now(UTC) >= lasts.soon:
                _log.warning(_ENDS, f"{lasts.ends:%Y-%m-%d %H:%M} UTC")
            if stop.wait(_SELDOM_S):
                return _DONE


def _looked_through(path: Path) -> RouterFile:
    """Read and check a router's file; raises ConfigError if the file or its certificate cannot be used."""
    try:
        file = router_check.read(path)
    except BusError as error:
        raise ConfigError(str(error)) from None
    if file.identity is not None and (wrong := faults(file.identity, datetime.now(UTC), (Role.ROUTER,))):
        raise ConfigError("\n".join(wrong))
    for words in (*file.faults, *router_cross_checks.faults(file)):
        _log.warning("%s: %s", path, words)
    return file


def _listening_router(args: argparse.Namespace, *, written: bool) -> Router:
    if written:
        if args.listen:
            raise ValueError(
                f"{args.config} already sets the endpoints: omit --listen, or change the endpoints in that file"
            )
        return Router.of_file(args.config)
    root = load(args.config, Root) if args.config else None
    if root is not None and root.bus.certified and not args.listen:
        raise ConfigError(
            f"{args.config}: [bus] has certificates, but a router started from this file would not check them. Write a router"
            " file with `truerate pki router`, then run `truerate router --config router.json5`"
        )
    listen = root.router.listen if root else (LOCAL,)
    listen = check_endpoints(args.listen, "--listen") if args.listen else listen
    for words in router_check.open_to_others(listen):
        _log.warning("%s", words)
    return Router(listen, shed=keys.VIEWED)
