"""The verb `truerate dashboard`: serves the ward's web page, and makes password hashes for it."""

import argparse
import getpass
import secrets
import sys
from pathlib import Path

from msgspec.structs import replace

from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError, check, check_endpoints
from bridge.config.ward_file import WardFile
from estimator.cli.ward_options import person

_EXAMPLES = """examples:
  truerate dashboard --config configs/demo.toml        then open http://127.0.0.1:8090
  truerate dashboard password --name nurse             asks for a password, prints lines for the ward file
  truerate dashboard password --name script --token    makes up a long password, for a program"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `dashboard`."""
    verb = add_verb(verbs, "dashboard", _dashboard, "serve the ward's pages to browsers, or hash a password for them")
    verb.epilog, verb.formatter_class = _EXAMPLES, argparse.RawDescriptionHelpFormatter
    verb.add_argument(
        "what",
        nargs="?",
        choices=["password"],
        metavar="password",
        help="hash a password instead of serving pages",
    )
    verb.add_argument("--config", type=Path, help="the ward file: names the ward, its routers and [dashboard]")
    verb.add_argument("--ward", help="the ward's name (default: from the ward file, else 'ward')")
    verb.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help="a router's address (default: from the ward file)"
    )
    verb.add_argument(
        "--listen", metavar="HOST:PORT", help="address of the pages (default: from the ward file, else 127.0.0.1:8090)"
    )
    verb.add_argument("--name", help="with `password`: the person's name")
    verb.add_argument("--token", action="store_true", help="with `password`: make up a long password, for a program")


def _dashboard(given: argparse.Namespace) -> int:
    if given.what == "password":
        return _password(given)
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
    return run(ward, file)


def _password(given: argparse.Namespace) -> int:
    from estimator.web.passwords import hashed  # noqa: PLC0415

    try:
        name = check(given.name or person().lower(), "--name")
        password = secrets.token_urlsafe(24) if given.token else asked()
        words = hashed(password)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if given.token:
        print(f"token (not shown again): {name}.{password}", file=sys.stderr)
    print(f'[[dashboard.people]]\nname = "{name}"\npassword = "{words}"')
    return 0


def asked() -> str:
    """Ask for a password twice; without a terminal, read the first line of standard input."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\n")
    try:
        password = getpass.getpass("password: ")
        again = getpass.getpass("the same again: ")
    except EOFError:
        print(file=sys.stderr)
        raise ValueError("no password was given: type one, or use --token") from None
    if password != again:
        raise ValueError("the two passwords differ: run the command again")
    return password
