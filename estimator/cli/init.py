"""Verb `truerate init`: sets up a ward on this machine."""

import argparse
import os
import secrets
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError, check
from bridge.terminal.console import plain_console
from bridge.terminal.plurals import count

if TYPE_CHECKING:
    from bridge.diagnose.port_probe import Verdict
    from estimator.config.dashboard import PersonRole
    from estimator.installation.ward_text import Plan

_EXAMPLES = """examples:
  truerate init ward-3                                     one machine; the page opens on this machine only
  truerate init ward-3 --host ward-3.example --person nurse
                                                           the page over TLS, for tablets; asks for the nurse's password
  truerate init ward-3 --host 10.0.0.5 --bridge bridge-2   a second machine has devices, too
  truerate init ward-3 --virtual 3 --dry-run               print what would be done, with three simulated devices

A second run keeps existing files and adds what is missing: newly plugged devices, new people, further machines."""
_SERVICES = ("router", "bridge", "estimator", "dashboard", "recorder")
_HERE, _DATA, _DEFAULTS = Path("/etc/truerate"), Path("/var/lib/truerate"), Path("/etc/default/truerate")


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `init` to the command line."""
    does = "set up a ward on this machine: ward file, certificates, people, services"
    verb = add_verb(verbs, "init", _init, does, _EXAMPLES)
    verb.add_argument("ward", metavar="WARD", help="name of the ward, such as ward-3")
    verb.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="NAME",
        help="name or address by which tablets and other machines reach this machine; repeatable, the best first",
    )
    verb.add_argument(
        "--bridge",
        dest="bridges",
        action="append",
        default=[],
        metavar="ID",
        help="bridge on another machine; repeatable. Its files are collected in FOLDER/machines/ID",
    )
    verb.add_argument(
        "--person",
        dest="people",
        action="append",
        default=[],
        metavar="NAME",
        help="person who may give commands on the page; repeatable. Asks for a password; without a terminal, generates one",
    )
    verb.add_argument(
        "--administrator",
        dest="administrators",
        action="append",
        default=[],
        metavar="NAME",
        help="person who may also manage the people on the page; repeatable",
    )
    verb.add_argument("--virtual", type=int, default=0, metavar="N", help="simulated devices, to try the installation")
    verb.add_argument("--no-scan", action="store_true", help="do not listen on the serial ports for devices")
    verb.add_argument(
        "--folder", type=Path, default=_HERE, help="folder of ward file and certificates (default: %(default)s)"
    )
    verb.add_argument("--data", type=Path, default=_DATA, help="folder of store and recordings (default: %(default)s)")
    verb.add_argument("--dry-run", action="store_true", help="print what would be done, and change nothing")


def _init(given: argparse.Namespace) -> int:
    from estimator.installation.ward import install  # noqa: PLC0415 - certificates are slow to import
    from estimator.installation.ward_text import Plan  # noqa: PLC0415
    from estimator.web.passwords import hashed  # noqa: PLC0415

    try:
        if not 0 <= given.virtual <= 100:
            raise ValueError(f"--virtual is {given.virtual}: use 0 to 100")
        plan = Plan(
            check(given.ward, "WARD"),
            given.folder.absolute(),
            given.data.absolute(),
            tuple(dict.fromkeys(given.hosts)),
            tuple(check(bridge, "--bridge") for bridge in dict.fromkeys(given.bridges)),
            _people(given),
            given.virtual,
        )
        found = [] if given.no_scan or given.virtual else _scanned()
        plan, ward, left = install(plan, found, lambda name: hashed(_password(name)), print, dry=given.dry_run)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    devices = len(ward.bridge.devices) if ward.bridge else 0
    units = [f"truerate-{name}" for name in _SERVICES if devices or name != "bridge"]
    if plan.bridges:
        _use_router_file(plan.folder, dry=given.dry_run)
    if plan.folder == _HERE:
        _enable(units, dry=given.dry_run)
    else:
        left.append(f"start each in its own terminal, as the services run a ward of {_HERE} alone:")
        left += (f"    {words}" for words in _by_hand(plan, bridge=bool(devices)))
    print(f"\nWard {plan.ward}: {count(devices, 'device')}. Page: {plan.page(ward.dashboard.listen)}\nLeft to do:")
    for words in left:
        print(words if words.startswith(" ") else f"- {words}")
    return 0


def _people(given: argparse.Namespace) -> "dict[str, PersonRole]":
    found: dict[str, PersonRole] = {check(name, "--person"): "operator" for name in given.people}
    return found | {check(name, "--administrator"): "administrator" for name in given.administrators}


def _by_hand(plan: "Plan", *, bridge: bool) -> list[str]:
    """Return the commands that run a ward without services."""
    ward = plan.folder / "ward.toml"
    router = plan.folder / "router.json5" if plan.bridges else ward
    return [
        f"truerate router --config {router}",
        *([f"truerate bridge run {ward}"] if bridge else []),
        f"truerate estimator serve {ward}",
        f"truerate dashboard --config {ward}",
        f"truerate record --config {ward}",
    ]


def _scanned() -> "list[Verdict]":
    """Listen on every serial port for devices."""
    from bridge.diagnose.port_probe import bauds, examine  # noqa: PLC0415
    from bridge.diagnose.protocol_guess import candidates  # noqa: PLC0415
    from bridge.diagnose.serial_ports import find  # noqa: PLC0415
    from bridge.drivers import registry  # noqa: PLC0415

    tried = candidates(registry.kinds().values())
    with plain_console(stderr=True).status("") as status:
        return [examine(each, tried, bauds(tried), 1.5, status.update) for each in find()]


def _password(name: str) -> str:
    from estimator.cli.people import asked  # noqa: PLC0415

    if sys.stdin.isatty():
        print(f"A password for {name}:", file=sys.stderr)
        return asked()
    password = secrets.token_urlsafe(12)
    print(f"password of {name} (not shown again): {password}", file=sys.stderr)
    return password


def _use_router_file(folder: Path, *, dry: bool) -> None:
    """Let the router's unit take the file with the rules for other machines."""
    line = f"ROUTER_CONFIG={folder / 'router.json5'}\n"
    if folder != _HERE or (_DEFAULTS.exists() and line in _DEFAULTS.read_text("utf-8")):
        return
    print(f"{'would add' if dry else 'added'} to {_DEFAULTS}: {line.strip()}")
    if not dry:
        with _DEFAULTS.open("a", encoding="utf-8") as file:
            file.write(line)


def _enable(units: list[str], *, dry: bool) -> None:
    """Start the services now and at every boot, if this machine runs systemd and has them."""
    words = ["systemctl", "enable", "--now", "truerate.target", "truerate-backup.timer", *units]
    there = Path("/run/systemd/system").exists() and shutil.which("systemctl") and os.geteuid() == 0
    if dry or not there:
        print(f"{'would run' if dry else 'run, as root'}: {' '.join(words)}")
    elif failed := subprocess.run(words, capture_output=True, text=True, check=False).stderr.strip():
        print(failed, file=sys.stderr)
