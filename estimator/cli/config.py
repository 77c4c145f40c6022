"""Verb `truerate config check`: validates ward and router files, and checks that they agree with each other."""

import argparse
import os
from datetime import UTC, datetime
from pathlib import Path

from bridge.bus import router_check
from bridge.bus.contract import BusError
from bridge.cli.parser import Verbs, add_verb
from bridge.config import cross_checks
from bridge.config.schema import ConfigError, load
from bridge.terminal.plurals import count


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `config check` to the command line."""
    config = verbs.add_parser(
        "config",
        help="check ward files and router files",
        description="Example: truerate config check configs/demo.toml",
    ).add_subparsers(metavar="VERB", required=True)
    verb = add_verb(
        config, "check", _config_check, "check a ward file; an unknown key is reported with the nearest valid key"
    )
    verb.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="ward files (.toml) and routers' files (.json5); several files are also checked against each other",
    )


def _config_check(given: argparse.Namespace) -> None:
    from estimator.config.schema import Ward  # noqa: PLC0415
    from estimator.service.privacy import advice, exposed  # noqa: PLC0415

    wards, routers, wrong, absent = {}, [], list[str](), list[str]()
    files = list({os.path.realpath(file): file for file in given.files}.values())  # a file with two names counts once
    for file in files:
        if file.suffix in (".json5", ".json"):
            try:
                routers.append(router_check.read(file))
            except BusError as error:
                wrong.append(str(error))
        else:
            wards[file] = ward = load(file, Ward)
            if ward.dashboard.people_file:
                load(ward.dashboard.people_file, Ward)
            if ward.estimator is not None and not (folder := Path(ward.estimator.store).absolute().parent).is_dir():
                absent.append(
                    f"{file}: [estimator]: store is {ward.estimator.store!r}: the folder {folder} does not exist on this"
                    " machine; the estimator creates it at its start, if permitted"
                )
    # If a router's file cannot be read, its members are unknown, so nothing can be said about the other files.
    wrong += cross_checks.faults(wards, routers if len(routers) + len(wards) == len(files) else [], datetime.now(UTC))
    if wrong:
        raise ConfigError("\n".join(wrong))
    for file, ward in wards.items():
        parts = [
            count(len(ward.bridge.devices), "device") if ward.bridge else "no bridge",
            f"estimator {ward.estimator.id}" if ward.estimator else "no estimator",
        ]
        print(f"{file}: valid. Ward {ward.ward}: {', '.join(parts)}")
    for file, ward in wards.items():
        if found := exposed(file, ward):
            said, do = advice(found)
            print(f"{file}: {said}: {do}")
    for words in (*absent, *cross_checks.soon(wards, routers), *cross_checks.unused(wards)):
        print(words)
    for router in routers:
        print(f"{router.path}: valid. Router at {', '.join(router.listen)}, {count(len(router.members), 'member')}")
