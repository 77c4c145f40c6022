"""Command-line verbs `truerate pki ...`: arguments in, exit code out; `show` exits with 1 if a certificate needs action."""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from bridge.bus import router_file
from bridge.cli.parser import Verbs, sentence
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

ROLES = """who: ROLE:NAME. Roles: bridge (its [bridge] id as the name), estimator (its [estimator] id), viewer (looks),
commander (looks, and gives commands: a nurse station, a dashboard where somebody may), recorder, router,
page (the dashboard's certificate for browsers).
examples:
  truerate pki init --ward ward-3
  truerate pki issue router:router-1 --host 10.0.0.5 --host ward-3.example
  truerate pki issue bridge:bridge-1 estimator:estimator-1 commander:desk
  truerate pki router router:router-1 --ward ward-3 --listen tls/10.0.0.5:7447 > router.json5
  truerate pki show                                  exit code 1 where one ends within 14 days, or is in its last third
docs/security.md goes through it, word by word."""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `pki`; each of its verbs sets `run(args) -> exit code`."""
    pki = verbs.add_parser(
        "pki",
        help="certificates: who may be what on the bus",
        epilog=ROLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    inner = pki.add_subparsers(metavar="VERB", required=True)
    verb = _verb(inner, "init", _init, "make an authority, for a ward that has none")
    verb.add_argument("--ward", default="ward", help="whose it is, for its name")
    verb = _verb(inner, "issue", _issue, "make certificate and key for roles")
    _who(verb, "+")
    verb.add_argument("--days", type=int, default=DAYS, help="how long it lasts (default: %(default)s)")
    verb.add_argument("--host", action="append", default=[], help="of a router: a name or address it is reached at")
    verb = _verb(inner, "renew", _renew, "make certificates last longer; the keys stay")
    _who(verb, "*")
    verb.add_argument(
        "--soon", action="store_true", help="all that end within 14 days, or are in the last third of fewer weeks"
    )
    verb.add_argument("--days", type=int, help="how long it lasts from now on (default: as long as before)")
    verb = _verb(inner, "revoke", _revoke, "never use a name again: its holder's key is lost or stolen")
    _who(verb, 1)
    verb.add_argument("--reason", default="", help="kept beside it")
    _verb(inner, "revoke-list", _revoke_list, "the names that were revoked, when and why")
    verb = _verb(inner, "show", _show, "who, in what role, until when; exit code 1 where somebody has to act")
    verb.add_argument("--json", action="store_true", help="one JSON object in place of words")
    verb = _verb(inner, "router", _router, "a router's file, for zenohd and `truerate router`: rules for all there are")
    _who(verb, 1)
    verb.add_argument("--ward", action="append", required=True, help="may be given again: a hospital's")
    verb.add_argument("--listen", action="append", required=True, metavar="ENDPOINT", help="such as tls/10.0.0.5:7447")
    verb.add_argument("--join", action="append", default=[], metavar="ENDPOINT", help="another router, a hospital's")
    verb.add_argument(
        "--member",
        action="append",
        default=[],
        metavar="ROLE:NAME[@WARD]",
        help="only these, in this ward (default: all, in all)",
    )
    verb.add_argument("--at", type=Path, metavar="DIR", help="where the files are on the router's machine")
    verb.add_argument(
        "--ca", metavar="FILE", help="there: a site's own authority, where its certificates are not of here"
    )


def _verb(verbs: "Verbs[argparse.ArgumentParser]", name: str, run: object, does: str) -> argparse.ArgumentParser:
    verb = verbs.add_parser(
        name,
        help=does,
        description=sentence(does),
        epilog=ROLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.add_argument("--folder", type=Path, default=Path("pki"), help="where all is kept (default: pki)")
    verb.set_defaults(run=_guarded, verb=run)
    return verb


def _who(verb: argparse.ArgumentParser, many: str | int) -> None:
    verb.add_argument("who", nargs=many, metavar="ROLE:NAME")


def _guarded(given: argparse.Namespace) -> int:
    try:
        days = getattr(given, "days", None)
        if days is not None and not 1 <= days <= _MOST_DAYS:
            raise ValueError(f"--days is {days}; 1 to {_MOST_DAYS} is taken")
        return int(given.verb(given))
    except ValueError as error:
        raise ConfigError(str(error)) from None


def _members(given: argparse.Namespace) -> list[Member]:
    members = [Member.parse(text) for text in dict.fromkeys(given.who)]
    for member in members:
        if member.generation > 1:
            raise ValueError(f"{member.common_name}: say {member.label}; which generation of it counts is known here")
    return members


def _init(given: argparse.Namespace) -> int:
    Folder(given.folder).make(f"truerate {check(given.ward, '--ward')}", utc_now())
    print(
        f"{given.folder}: an authority. Keep ca.key off the ward's machines, and back it up; ca.pem goes to all of them."
    )
    return 0


def _issue(given: argparse.Namespace) -> int:
    folder, members = Folder(given.folder), _members(given)
    if given.host and not any(member.role.serves for member in members):
        raise ValueError(
            "--host is for routers and pages: nobody connects to any other, and its certificate names no host"
        )
    for member in members:
        hosts = tuple(given.host) if member.role.serves else ()
        _made(folder.issue(member, utc_now(), given.days, hosts))
    if again := [member for member in map(folder.current, members) if member.generation > 1]:
        names = ", ".join(member.common_name for member in again)
        print(f"{names}: of another name than before: [bus] of its ward file names these files from now on.")
    print("Routers do not know new names by themselves: write their files anew (truerate pki router).")
    return 0


def _renew(given: argparse.Namespace) -> int:
    folder, now, members = Folder(given.folder), utc_now(), _members(given)
    if given.soon:
        members += [Member(member.role, member.name) for member, lasts in folder.members() if now >= lasts.soon]
    if not members and not given.soon:
        raise ValueError("whose? Name some, as bridge:bridge-1, or say --soon")
    if not members:
        print("none ends soon; nothing was renewed")
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
        f"{gone.common_name} is revoked. zenoh reads no list of revoked certificates: nothing has changed until the routers'"
        " files are written anew (truerate pki router), both of each, and the routers started again.\n"
        f"A new pair for its holder: truerate pki issue {gone.label}"
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

    yield row("authority", "", folder.authority_lasts(), "make a new one, and with it all certificates anew")
    for member, lasts in folder.members():
        yield row(member.role.value, member.name, lasts, f"truerate pki renew {member.label}")


def _router(given: argparse.Namespace) -> int:
    folder = Folder(given.folder)
    router = folder.current(_members(given)[0])
    if router.role is not Role.ROUTER:
        raise ValueError(f"{router.label} is no router")
    wards = [check(ward, "--ward") for ward in dict.fromkeys(given.ward)]
    listen, join = check_endpoints(given.listen, "--listen"), tuple(given.join)
    if others := [endpoint for endpoint in (*listen, *join) if not endpoint.startswith("tls/")]:
        raise ValueError(f"{others[0]!r}: a router with certificates goes by tls alone, such as 'tls/10.0.0.5:7447'")
    known = [member for member, _ in folder.members()]
    places = dict.fromkeys(place for text in given.member for place in _places(folder, text, wards))
    places = places or dict.fromkeys((ward, member) for member in known if member != router for ward in wards)
    if missing := [member.label for member in (router, *(one for _, one in places)) if member not in known]:
        raise ValueError(f"{', '.join(missing)}: no certificate in {folder.path}; `truerate pki issue` makes one")
    files = Folder((given.at or folder.path).absolute()).gate(router)
    if given.ca:
        files = replace(files, ca=given.ca)
    else:
        folder.admit(router, dict.fromkeys(member for _, member in places))
        print(f"{folder.gate(router).ca}: whose certificates are good; to {files.ca} with it", file=sys.stderr)
    title = (
        f"The router {router.name} of {', '.join(wards)}.\n"
        "Written by `truerate pki router`: write it anew rather than change it."
    )
    print(router_file.rendered(router_file.guarded(listen, files, list(places), join), title), end="")
    return 0


def _places(folder: Folder, text: str, wards: list[str]) -> list[tuple[str, Member]]:
    who, _, where = text.partition("@")
    if where and where not in wards:
        raise ValueError(f"--member {text!r}: {where!r} is none of the wards, {', '.join(wards)}")
    return [(ward, folder.current(Member.parse(who))) for ward in wards if where in ("", ward)]
