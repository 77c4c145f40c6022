"""Loader of a TOML file as a frozen, typed object; an error names the file, table, key and nearest valid name.

The type is a msgspec Struct of Structs that forbid unknown fields. A field may also have a class that is not a
Struct but has a class method `from_table`. That method converts the table to an object, or raises ValueError with a
sentence.
"""

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import msgspec.inspect as inspection

from bridge.runtime import os_errors
from bridge.runtime.regular_file import content

T = TypeVar("T")

#: most parts of a dotted name, as in `a.b.c`: the parser's time and memory grow with their square
MAX_PARTS = 16

#: most characters of an error: a name in the file may be as long as the file
_LONGEST = 2000

_NAME = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]*+')"""
_LONG_NAME = re.compile(rf"(?<![\w-])(?:{_NAME}[ \t]*+\.[ \t]*+){{{MAX_PARTS}}}")
_PATH = re.compile(r"(?P<text>.*?)(?: - at `(?P<path>\$[^`]*)`)?\Z", re.DOTALL)
_STEP = re.compile(r"\.([^.\[]+)|\[(\d+)\]|\[\.\.\.\]")
#: keys of earlier ward files: what to do instead
_REMOVED: Final[Mapping[tuple[str | int, ...], str]] = {
    ("devices", "file"): "list the ids in `enrolled`: a change of the ward file takes effect at once",
    ("estimator", "placements"): "use `truerate placement set`, or the device's page, to state who wears a device",
}
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`")
_MISSING = re.compile(r"Object missing required field `(.*)`")
_NO_CHOICE = re.compile(r"Invalid enum value '?(.*?)'?")
_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text in quotes",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


class ConfigError(Exception):
    """Invalid configuration: the message names the file, the place in it, and the accepted values."""


def load(path: Path | str, kind: type[T]) -> T:
    """Read a TOML file as an object of type `kind`, a msgspec Struct that forbids unknown fields.

    Raises ConfigError, with a one-line message, for a file that is missing, unreadable or invalid.
    """
    try:
        return parsed(content(Path(path)), path, kind)
    except FileNotFoundError:
        raise ConfigError(
            f"{path}: there is no such file; give the path of a TOML file, such as configs/ward.toml"
        ) from None
    except OSError as error:
        raise ConfigError(f"{path}: {os_errors.why(error)}") from None


def parsed(found: bytes, path: Path | str, kind: type[T]) -> T:
    """Parse the bytes of a TOML file into an object of type `kind`, a msgspec Struct.

    path: the file's name in errors. Raises ConfigError for invalid TOML and for content that does not fit `kind`.
    """
    try:
        text = found.decode("utf-8-sig")  # some editors write a byte order mark
        if long := _LONG_NAME.search(text):
            line = text.count("\n", 0, long.start()) + 1
            raise ConfigError(f"{path}: line {line}: a dotted name has more than {MAX_PARTS} parts: correct that name")
        tables = tomllib.loads(text)
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{path}: line {line} is not UTF-8 text: save the file as UTF-8 in your editor") from None
    except (ValueError, RecursionError) as error:  # also huge numbers and deeply nested lists
        raise ConfigError(f"{path}: not TOML: {error}. Correct that place; https://toml.io shows the syntax") from None
    try:
        return msgspec.convert(tables, kind, dec_hook=_from_table)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {_sentence(error, kind)[:_LONGEST]}") from None


def options(table: dict[str, Any], kind: type[T]) -> T:
    """Convert a TOML table to an object of type `kind`; for use in the `from_table` of a class.

    Raises ValueError with a sentence that names the wrong key.
    """
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise ValueError(_sentence(error, kind)) from None


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint for an unknown name: `did you mean 'x'?` with the nearest known name, else all known names.

    known: the valid names.
    """
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"there are {', '.join(names)}" if names else "there are none"


def _from_table(kind: type[Any], table: object) -> Any:
    build = getattr(kind, "from_table", None)
    if build is None:
        raise NotImplementedError(f"{kind.__name__} has no from_table")
    if not isinstance(table, dict):
        raise ValueError(f"expected a table, got {type(table).__name__}")  # noqa: TRY004 - msgspec adds the place to it
    return build(table)


def _sentence(error: msgspec.ValidationError, kind: type[Any]) -> str:
    match = _PATH.match(str(error))
    said, path = (match["text"], match["path"] or "$") if match else (str(error), "$")
    steps: list[str | int] = [int(number) if number else name for name, number in _STEP.findall(path)]
    own = isinstance(error.__cause__, ValueError)
    if unknown := _UNKNOWN.fullmatch(said):
        hint = nearest(unknown[1], _names(inspection.type_info(kind), steps))
        hint = _REMOVED.get((*steps, unknown[1])) or hint
        return f"{_table(steps)}unknown key {unknown[1]!r}; {hint}"
    if missing := _MISSING.fullmatch(said):
        return f"{_table(steps)}the key {missing[1]!r} is missing: add it"
    if own or not steps:
        return f"{_table(steps)}{said}"
    if no_choice := _NO_CHOICE.fullmatch(said):
        choices = _choices(inspection.type_info(kind), steps)
        return (
            f"{_table(steps[:-1])}key {steps[-1]!r}: unknown value {no_choice[1]!r}; {nearest(no_choice[1], choices)}"
        )
    item = f" #{int(steps.pop()) + 1}" if isinstance(steps[-1], int) else ""
    *table, key = steps
    words = re.sub(r"`([^`]*)`", lambda quoted: _words(quoted[1]), said)
    return f"{_table(table)}key {key!r}{item}: {words[:1].lower()}{words[1:]}"


def _words(types: str) -> str:
    return " or ".join(_WORDS.get(name, name) for name in types.split(" | ") if name != "null")


def _table(steps: list[str | int]) -> str:
    """Format a table's place: `[bridge]: `, `[[bridge.devices]] #2: `, or empty for the top level."""
    if not steps:
        return ""
    name = ".".join(step for step in steps if isinstance(step, str))
    return f"[[{name}]] #{steps[-1] + 1}: " if isinstance(steps[-1], int) else f"[{name}]: "


def _types(kind: inspection.Type, steps: list[str | int]) -> list[inspection.Type]:
    """Return the types allowed at the path `steps`."""
    if isinstance(kind, inspection.UnionType):
        return [found for option in kind.types for found in _types(option, steps)]
    inner: list[inspection.Type] = []
    if not steps:
        return [kind]
    if isinstance(kind, inspection.StructType):
        inner = [field.type for field in kind.fields if field.encode_name == steps[0]]
    elif isinstance(kind, inspection.VarTupleType | inspection.ListType):
        inner = [kind.item_type]
    elif isinstance(kind, inspection.DictType):
        inner = [kind.value_type]
    return [found for one in inner for found in _types(one, steps[1:])]


def _choices(kind: inspection.Type, steps: list[str | int]) -> list[str]:
    """Return the values allowed for the key at the path `steps`."""
    found = _types(kind, steps)
    enums = [str(member.value) for one in found if isinstance(one, inspection.EnumType) for member in one.cls]
    return enums + [str(value) for one in found if isinstance(one, inspection.LiteralType) for value in one.values]


def _names(kind: inspection.Type, steps: list[str | int]) -> list[str]:
    """Return the keys allowed in the table at the path `steps`."""
    structs = [one for one in _types(kind, steps) if isinstance(one, inspection.StructType)]
    return [field.encode_name for one in structs for field in one.fields]
