"""File that lists the people of a ward: finds, reads and edits it.

People are listed in the ward file, or in the file that its key `people_file` names: a ward file with people only.
"""

import re
from pathlib import Path
from typing import Any

import tomlkit
from msgspec.structs import replace

from bridge.runtime import whole_file
from bridge.runtime.regular_file import content
from bridge.toml.loader import ConfigError, load, parsed
from estimator.config.dashboard import Dashboard, Person
from estimator.config.schema import Ward

_BLOCK = "[[dashboard.people]]"
#: where a table begins; and comments and empty lines at the end of one
_TABLES, _AFTER = re.compile(r"^(?=\[)", re.MULTILINE), re.compile(r"(?:^[ \t]*(?:#.*)?\n)*\Z", re.MULTILINE)


def file_of(path: Path, ward: Ward) -> Path:
    """Return the file that lists the people of a ward: `people_file` if set, else the ward file. path: the ward file."""
    return Path(ward.dashboard.people_file or path)


def people_in(path: Path) -> tuple[Person, ...]:
    """Return the people that a file lists; empty for a missing file. Raises ConfigError for an invalid file."""
    return load(path, Ward).dashboard.people if path.exists() else ()


def with_people(settings: Dashboard, people: tuple[Person, ...]) -> Dashboard:
    """Return a copy of the dashboard's settings with these people. Raises ValueError if two have the same name."""
    return replace(settings, people=people, people_file="")


def empty(ward: str) -> str:
    """Return the text of a people file without people. ward: name of the ward."""
    return f'# People of ward {ward}, for its page. To change them: truerate people\nward = "{ward}"\n'


def put(path: Path, ward: str, person: Person) -> None:
    """Add a person to a people file, or replace the person of that name; other text stays, including comments.

    ward: name of the ward, for a new file. Raises ConfigError if the file is or would become invalid, and OSError if it
    cannot be written.
    """
    _change(path, ward, person.name, person)


def remove(path: Path, name: str) -> None:
    """Remove a person from a people file; other text stays, including comments.

    Raises ConfigError for an invalid file, and OSError if it cannot be written.
    """
    _change(path, "", name, None)


def _change(path: Path, ward: str, name: str, person: Person | None) -> None:
    text = (content(path) if path.exists() else empty(ward).encode()).decode("utf-8-sig")
    people = {one.name: one for one in parsed(text.encode(), path, Ward).dashboard.people}
    if person and name not in people:
        text = f'{text.rstrip()}\n\n{_BLOCK}\nname = "{name}"\n'
    text = "".join(_edited(block, name, person) for block in _TABLES.split(text))
    wanted = {one: people[one] for one in people if one != name} | ({name: person} if person else {})
    if {one.name: one for one in parsed(text.encode(), path, Ward).dashboard.people} != wanted:
        raise ConfigError(
            f"{path}: people are listed outside {_BLOCK}: give each a table {_BLOCK}, or edit the file by hand"
        )
    whole_file.rewrite(path, text.encode())


def _edited(block: str, name: str, person: Person | None) -> str:
    """Return one table of the file as it is to be; `name` is the person to replace, or without a person to remove.

    tomlkit gets no more than one table: what it removes from a table that is continued elsewhere stays there.
    """
    if not block.startswith(_BLOCK):
        return block
    end = _AFTER.search(block)
    body, after = (block[: end.start()], end[0]) if end else (block, "")
    document: Any = tomlkit.parse(body)
    entry = document["dashboard"]["people"][0]
    if entry.get("name") != name:
        return block
    if person is None:
        return after.lstrip("\n")
    entry.update({"role": person.role, "password": person.password})
    return f"{tomlkit.dumps(document).rstrip()}\n{after}"
