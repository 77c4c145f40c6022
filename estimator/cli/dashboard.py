"""Verb `truerate dashboard`: serves the ward's web page."""

import argparse
from pathlib import Path

from msgspec.structs import replace

from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError, check, check_endpoints
from bridge.config.ward_file import WardFile

_EXAMPLE = """Example: truerate dashboard --config configs/demo.toml, then open http://127.0.0.1:8090. `truerate people` sets who
may give commands on the pages."""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `dashboard` to the command line."""
    verb = add_verb(verbs, "dashboard", _dashboard, "serve the ward's pages to browsers", _EXAMPLE)
    verb.add_argument("--config", type=Path, help="the ward file: names the ward, its routers and [dashboard]")
    verb.add_argument("--ward", help="the ward's name (default: from the ward file, else 'ward')")
    verb.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help="a router's address (default: from the ward file)"
    )
    verb.add_argument(
        "--listen", metavar="HOST:PORT", help="address of the pages (default: from the ward file, else 127.0.0.1:8090)"
    )


def _dashboard(given: argparse.Namespace) -> int:
    from estimator.config.schema import Ward  # noqa: PLC0415
    from estimator.web.serve import LIVE, run  # noqa: PLC0415

    file = WardFile(given.config, Ward, ("estimator", "dashboard", "alerts"), LIVE) if given.config else None
    ward = file.root if file else Ward(ward="ward")
    try:
        if given.ward:
            ward = replace(ward, ward=check(given.ward, "ward"))
        if given.connect:
            ward = replace(ward, bus=replace(ward.bus, connect=check_endpoints(tuple(given.connect), "--connect")))
        if given.listen:
            ward = replace(ward, dashboard=replace(ward.dashboard, listen=given.listen))
    except ValueError as error:
        raise ConfigError(str(error)) from None
    listed = ward.dashboard.people_file
    people = WardFile(Path(listed), Ward, ("dashboard",), ("dashboard.people",)) if listed else None
    return run(ward, file, people)
