"""Verb `truerate people`: lists, adds and removes the people who may give commands on the ward's page."""

import argparse
import getpass
import secrets
import sys
from pathlib import Path

from msgspec.structs import replace

from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError, load
from bridge.wire.keys import check_id
from estimator.config.dashboard import PERSON_ROLES, Person

_ABOUT = """Lists and changes the people of a ward, in its ward file or in the `people_file` that it names. A running dashboard
takes a change within a second. An administrator can do the same on the page."""
_EXAMPLES = """examples:
  truerate people list --config configs/ward.toml
  truerate people add nurse --config configs/ward.toml               asks for a password
  truerate people add chief --administrator --config configs/ward.toml
  truerate people add script --token --config configs/ward.toml      generates a long password, for a program
  truerate people password nurse --config configs/ward.toml          asks for a new password
  truerate people role nurse administrator --config configs/ward.toml
  truerate people remove nurse --config configs/ward.toml"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verbs `people list|add|password|role|remove` to the command line."""
    inner = verbs.add_parser(
        "people",
        help="list, add and remove the people who may give commands on the page",
        description=_ABOUT,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    ).add_subparsers(metavar="VERB", required=True)
    add = add_verb(inner, "add", _add, "add a person")
    add.add_argument("--administrator", action="store_true", help="the person may also manage people on the page")
    password = add_verb(inner, "password", _password, "give a person a new password")
    role = add_verb(inner, "role", _role, "change what a person may do")
    remove = add_verb(inner, "remove", _remove, "remove a person")
    for verb in (add, password, role, remove):
        verb.add_argument("name", help="the person's name")
    role.add_argument("role", choices=PERSON_ROLES, help=" or ".join(PERSON_ROLES))
    for verb in (add, password):
        verb.add_argument("--token", action="store_true", help="generate a long password, for a program")
    for verb in (add_verb(inner, "list", _list, "list the people"), add, password, role, remove):
        verb.add_argument("--config", type=Path, required=True, help="the ward file")


def _list(given: argparse.Namespace) -> int:
    *_, people = _read(given)
    for one in people.values():
        print(f"{one.name:20} {one.role}")
    return 0 if people else 1


def _add(given: argparse.Namespace) -> None:
    name, role = check_id(given.name, "NAME"), PERSON_ROLES[given.administrator]
    path, ward, people = _read(given)
    if name in people:
        raise ConfigError(f"{name} is listed already: `truerate people password {name}` sets a new password")
    _put(path, ward, Person(name=name, role=role, password=_hash(given)), f"added {name}, {role}")


def _password(given: argparse.Namespace) -> None:
    path, ward, people = _read(given)
    person = _of(people, given.name)
    _put(path, ward, replace(person, password=_hash(given)), f"{person.name} has a new password")


def _role(given: argparse.Namespace) -> None:
    path, ward, people = _read(given)
    _put(path, ward, replace(_of(people, given.name), role=given.role), f"{given.name} is {given.role}")


def _put(path: Path, ward: str, person: Person, said: str) -> None:
    from estimator.config.people_file import put  # noqa: PLC0415 - tomlkit is slow to import

    put(path, ward, person)
    print(said)


def _remove(given: argparse.Namespace) -> None:
    from estimator.config.people_file import remove  # noqa: PLC0415 - as above

    path, _, people = _read(given)
    remove(path, _of(people, given.name).name)
    print(f"removed {given.name}")


def _read(given: argparse.Namespace) -> tuple[Path, str, dict[str, Person]]:
    """Return the file that lists the people, the ward, and the people by name."""
    from estimator.config.people_file import file_of, people_in  # noqa: PLC0415 - as above
    from estimator.config.schema import Ward  # noqa: PLC0415 - as above

    ward = load(given.config, Ward)
    path = file_of(given.config, ward)
    return path, ward.ward, {one.name: one for one in people_in(path)}


def _of(people: dict[str, Person], name: str) -> Person:
    if name not in people:
        raise ConfigError(f"unknown person {name!r}; known are: {', '.join(people) or 'none'}")
    return people[name]


def _hash(given: argparse.Namespace) -> str:
    from estimator.web.passwords import hashed  # noqa: PLC0415 - as above

    try:
        password = secrets.token_urlsafe(24) if given.token else asked()
        found = hashed(password)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if given.token:
        print(f"token (not shown again): {given.name}.{password}", file=sys.stderr)
    return found


def asked() -> str:
    """Ask for a password twice in the terminal and return it; without a terminal, read a line of standard input.

    Raises ValueError if the two passwords differ, or if no password is typed.
    """
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\n")
    try:
        password = getpass.getpass("password: ")
        again = getpass.getpass("repeat the password: ")
    except EOFError:
        print(file=sys.stderr)
        raise ValueError("no password was given: type a password, or use --token") from None
    if password != again:
        raise ValueError("the two passwords differ: run the command again")
    return password
