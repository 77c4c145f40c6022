"""Command-line verbs `truerate pki ...`: create, renew, revoke and list certificates.

Each verb returns an exit code; `show` returns 1 if a certificate must be renewed.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from bridge.bus import router_file
from bridge.cli.parser import Verbs, add_group, add_verb
from bridge.config.schema import ConfigError, check, check_endpoints
from bridge.pki.authority import DAYS
from bridge.pki.certificate_checks import Identity
from bridge.pki.certificate_files import Validity
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member, Role
from bridge.runtime.logs import printable
from bridge.terminal.console import plain_console
from bridge.terminal.tables import Column, Columns

#: longest life of a certificate, days; also keeps dates in range
_MOST_DAYS = 36_500

ROLES = """ROLE:NAME is a role and a name. Roles: bridge (NAME is the id in [bridge]), estimator (NAME is the id in
[estimator]), viewer (reads only), commander (reads and gives commands: a nurse station or dashboard), recorder, ros2
(`truerate outlet ros2`, and ROS 2 nodes that use the ward's router), router, page (the dashboard's certificate for browsers).
examples:
  truerate pki init --ward ward-3
  truerate pki issue router:router-1 --host 10.0.0.5 --host ward-3.example
  truerate pki issue bridge:bridge-1 estimator:estimator-1 commander:desk
  truerate pki router router:router-1 --ward ward-3 --listen tls/10.0.0.5:7447 > router.json5
  truerate pki show                                  exit code 1 if a certificate has to be renewed
docs/security.md explains each step."""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the command `pki` and its verbs to the parser; each verb sets `run(args)`, which returns the exit code."""
    inner = add_group(verbs, "pki", "make, renew and revoke certificates of routers and programs", ROLES)
    verb = _verb(inner, "init", _init, "make the certificate authority of a ward")
    verb.add_argument(
        "--ward", default="ward", help="name of the ward, part of the authority's name (default: %(default)s)"
    )
    verb = _verb(inner, "issue", _issue, "make certificates and keys", "+")
    verb.add_argument("--days", type=int, default=DAYS, help="lifetime in days (default: %(default)s)")
    _add_many(verb, "--host", "HOST", "host name or address of a router")
    verb = _verb(inner, "renew", _renew, "extend certificates; the keys stay the same", "*")
    verb.add_argument(
        "--soon",
        action="store_true",
        help="renew every certificate that expires within 14 days, or, with a lifetime under 6 weeks, in its last third",
    )
    verb.add_argument("--days", type=int, help="lifetime in days from now (default: the previous lifetime)")
    verb = _verb(inner, "revoke", _revoke, "revoke a certificate, for example after its key was stolen", 1)
    verb.add_argument("--reason", default="", help="reason, kept in the list of revoked names")
    _verb(inner, "revoke-list", _revoke_list, "list the revoked names, with time and reason")
    verb = _verb(
        inner,
        "show",
        _show,
        "list the certificates and their expiry dates; exit code 1 if a certificate has to be renewed",
    )
    verb.add_argument("--json", action="store_true", help="print one JSON object")
    verb = _verb(
        inner, "router", _router, "print a router's file, with access rules, for `truerate router` and zenohd", 1
    )
    _add_many(verb, "--ward", "WARD", "ward to serve", required=True)
    _add_many(verb, "--listen", "ENDPOINT", "endpoint to listen on, such as tls/10.0.0.5:7447", required=True)
    _add_many(verb, "--join", "ENDPOINT", "endpoint of another router to connect to")
    _add_many(
        verb, "--member", "ROLE:NAME[@WARD]", "member to admit, in this ward (default: all members, in all wards)"
    )
    verb.add_argument(
        "--at",
        type=Path,
        metavar="DIR",
        help="folder of the certificate files on the router's machine (default: --folder)",
    )
    verb.add_argument(
        "--ca",
        metavar="FILE",
        help="path of your own authority's PEM file on the router's machine, if your own authority signed the certificates",
    )


def _verb(
    verbs: "Verbs[argparse.ArgumentParser]", name: str, run: object, does: str, who: str | int = 0
) -> argparse.ArgumentParser:
    """Add a verb. who: how many certificates it takes, as argparse's nargs."""
    verb = add_verb(verbs, name, _guarded, does, ROLES)
    if who:
        verb.add_argument("who", nargs=who, metavar="ROLE:NAME", help="role and name of the certificate; see below")
    verb.add_argument(
        "--folder", type=Path, default=Path("pki"), help="folder of the authority and the certificates (default: pki)"
    )
    verb.set_defaults(verb=run)
    return verb


def _add_many(verb: argparse.ArgumentParser, option: str, metavar: str, does: str, *, required: bool = False) -> None:
    verb.add_argument(
        option, action="append", default=[], required=required, metavar=metavar, help=f"{does}; repeatable"
    )


def _guarded(given: argparse.Namespace) -> int:
    try:
        days = getattr(given, "days", None)
        if days is not None and not 1 <= days <= _MOST_DAYS:
            raise ValueError(f"--days is {days}: use 1 to {_MOST_DAYS}")
        return int(given.verb(given))
    except ValueError as error:
        raise ConfigError(str(error)) from None


def _members(given: argparse.Namespace) -> list[Member]:
    members = [Member.parse(text) for text in dict.fromkeys(given.who)]
    for member in members:
        if member.generation > 1:
            raise ValueError(
                f"{member.common_name}: write {member.label} without a generation number; truerate adds the number"
            )
    return members


def _init(given: argparse.Namespace) -> int:
    Folder(given.folder).make(f"truerate {check(given.ward, '--ward')}", utc_now())
    print(
        f"Authority made in {given.folder}. Keep ca.key off the ward's machines and back it up. Copy ca.pem to every machine."
    )
    return 0


def _issue(given: argparse.Namespace) -> int:
    folder, members = Folder(given.folder), _members(given)
    if given.host and not any(member.role.serves for member in members):
        raise ValueError(
            "--host applies only to certificates of routers and pages: leave it out, or name a router, such as router:router-1"
        )
    for member in members:
        hosts = tuple(given.host) if member.role.serves else ()
        _made(folder.issue(member, utc_now(), given.days, hosts))
    if again := [member for member in map(folder.current, members) if member.generation > 1]:
        names = ", ".join(member.common_name for member in again)
        print(f"{names}: the name is new. Enter the new certificate and key in [bus] of the program's ward file.")
    print("Routers do not know the new names yet: write the routers' files again with `truerate pki router`.")
    return 0


def _renew(given: argparse.Namespace) -> int:
    folder, now, members = Folder(given.folder), utc_now(), _members(given)
    if given.soon:
        members += [Member(member.role, member.name) for member, lasts in folder.members() if now >= lasts.soon]
    if not members and not given.soon:
        raise ValueError("no certificate is named: name one or more, such as bridge:bridge-1, or use --soon")
    if not members:
        print("No certificate expires soon: nothing to renew.")
    wrong = list[str]()
    for member in dict.fromkeys(members):  # one failed renewal must not stop the others
        try:
            _made(folder.renew(member, now, given.days))
        except ValueError as error:
            wrong.append(str(error))
    if wrong:
        raise ValueError("\n".join(wrong))
    return 0


def _made(files: Identity) -> None:
    print(f"{files.certificate}  {files.key}")


def _revoke(given: argparse.Namespace) -> int:
    gone = Folder(given.folder).revoke(_members(given)[0], utc_now(), given.reason)
    print(
        f"{gone.common_name} is revoked. Routers still accept it: zenoh reads no revocation list. Write both files of each router"
        " again (truerate pki router) and restart the routers.\n"
        f"New certificate for the same program: truerate pki issue {gone.label}"
    )
    return 0


def _revoke_list(given: argparse.Namespace) -> int:
    for name, words in Folder(given.folder).revoked().items():
        print(printable(f"{name}  {words}"))
    return 0


def _show(given: argparse.Namespace) -> int:
    folder = Folder(given.folder)
    rows = list(_rows(folder, utc_now()))
    if given.json:
        print(json.dumps({"certificates": rows, "revoked": folder.revoked()}))
    else:
        table = Columns(
            [Column("role"), Column("who", least=12), Column("until"), Column("days"), Column("what to do", least=20)]
        )
        for row in rows:
            table.add(row["role"], row["who"], row["until"][:10], str(row["days"]), row["trouble"])
        plain_console().print(table)
    return 1 if any(row["trouble"] for row in rows) else 0


def _rows(folder: Folder, now: datetime) -> Iterator[dict[str, Any]]:
    """One row per certificate, the authority's first; `trouble` is empty if nothing has to be done."""

    def row(role: str, who: str, lasts: Validity, remedy: str) -> dict[str, Any]:
        trouble = f"expire{'d' if now > lasts.ends else 's soon'}: {remedy}" if now >= lasts.soon else ""
        until, days = lasts.ends.isoformat(), (lasts.ends - now).days
        return {"role": role, "who": who, "until": until, "days": days, "trouble": trouble}

    yield row("authority", "", folder.authority_lasts(), "make a new authority, then issue all certificates again")
    for member, lasts in folder.members():
        yield row(member.role.value, member.name, lasts, f"truerate pki renew {member.label}")


def _router(given: argparse.Namespace) -> int:
    folder = Folder(given.folder)
    router = folder.current(_members(given)[0])
    if router.role is not Role.ROUTER:
        raise ValueError(f"{router.label} is not a router: name one, such as router:router-1")
    wards = [check(ward, "--ward") for ward in dict.fromkeys(given.ward)]
    listen, join = check_endpoints(given.listen, "--listen"), tuple(given.join)
    if others := [endpoint for endpoint in (*listen, *join) if not endpoint.startswith("tls/")]:
        raise ValueError(f"{others[0]!r}: a router with certificates needs tls, such as 'tls/10.0.0.5:7447'")
    known = [member for member, _ in folder.members()]
    places = dict.fromkeys(place for text in given.member for place in _places(folder, text, wards))
    places = places or dict.fromkeys((ward, member) for member in known if member != router for ward in wards)
    if missing := [member.label for member in (router, *(one for _, one in places)) if member not in known]:
        raise ValueError(f"{', '.join(missing)}: no certificate in {folder.path}; make one with `truerate pki issue`")
    files = Folder((given.at or folder.path).absolute()).gate(router)
    if given.ca:
        files = replace(files, ca=given.ca)
    else:
        folder.admit(router, dict.fromkeys(member for _, member in places))
        print(
            f"Copy {folder.gate(router).ca} (the issuers this router accepts) to {files.ca} on the router's machine",
            file=sys.stderr,
        )
    title = (
        f"Router {router.name} of {', '.join(wards)}.\n"
        "Written by `truerate pki router`: do not edit this file; run the command again."
    )
    print(router_file.rendered(router_file.guarded(listen, files, list(places), join), title), end="")
    return 0


def _places(folder: Folder, text: str, wards: list[str]) -> list[tuple[str, Member]]:
    who, _, where = text.partition("@")
    if where and where not in wards:
        raise ValueError(f"--member {text!r}: {where!r} is not a ward of this router: use {', '.join(wards)}")
    return [(ward, folder.current(Member.parse(who))) for ward in wards if where in ("", ward)]
