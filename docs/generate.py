"""Reference pages that are generated from the code: the command line from argparse, the configuration from its schema."""

import inspect
from collections.abc import Iterator

import msgspec
from sphinx.pycode import ModuleAnalyzer

from bridge.cli.parser import Parser
from bridge.config.enrolment import Enrolment
from bridge.config.schema import Bridge, Bus, Router
from bridge.drivers.registry import OURS, kinds
from bridge.reasons.catalogue import catalogue
from bridge.reasons.codes import Code
from bridge.recording.settings import Recorder
from estimator.cli.main import build
from estimator.config.dashboard import Dashboard
from estimator.config.schema import Estimator

TABLES = {
    "bus": Bus,
    "router": Router,
    "bridge": Bridge,
    "devices": Enrolment,
    "estimator": Estimator,
    "recorder": Recorder,
    "dashboard": Dashboard,
}

#: the rule for every verb
EXIT_CODES = """| exit code | meaning |
|---|---|
| 0 | done |
| 1 | done, but with a finding that needs a person; or refused because of the data: a recording, a device, the store, the bus |
| 2 | wrong usage: an option, an argument, or a file of settings (ward file, profile, certificates) that cannot be used |
| 130 | interrupted by Ctrl-C; a verb that runs until it is stopped ends with 0 |"""


def command_line() -> str:
    """The help of every command, as Markdown."""
    pages = "\n\n".join(
        f"## {parser.prog}\n\n```text\n{parser.format_help().rstrip()}\n```" for parser in _all(build())
    )
    return f"# Command line\n\nEvery command with its options, as `--help` prints them.\n\n{EXIT_CODES}\n\n{pages}\n"


def _all(parser: Parser) -> Iterator[Parser]:
    yield parser
    for inner in parser.commands.values():
        yield from _all(inner)


def codes() -> str:
    """Every code of a reason with its parameters and its texts, as Markdown."""
    rows = [
        f"| `{code}` | {', '.join(code.params)} | {catalogue('en').sentences[code]} | {catalogue('zh').sentences[code]} |"
        for code in Code
    ]
    return (
        "# Codes\n\nReasons travel as codes with parameters. Each program shows them in its reader's language.\n\n"
        "| code | parameters | English | Chinese |\n|---|---|---|---|\n" + "\n".join(rows) + "\n"
    )


def configuration() -> str:
    """Every table and key of the ward file, as Markdown."""
    drivers = {f"bridge.devices with driver {name}": kinds()[name].options for name in OURS}
    return "\n\n".join(
        (
            (
                '# Configuration\n\nThe keys of a ward file (TOML). The first key is `ward = "NAME"`. '
                "An unknown key is an error that names the nearest one."
            ),
            *(_table(name, of) for name, of in (TABLES | drivers).items()),
        )
    )


def _table(name: str, of: type[msgspec.Struct]) -> str:
    comments: dict[str, str] = {}
    for each in reversed(of.__mro__[:-1]):
        if issubclass(each, msgspec.Struct) and each is not msgspec.Struct:
            found = ModuleAnalyzer.for_module(each.__module__).find_attr_docs()
            comments |= {
                key: " ".join(lines).strip() for (owner, key), lines in found.items() if owner == each.__name__
            }
    rows = [
        f"| `{field.encode_name}` | {_default(field)} | {comments.get(field.name, '')} |"
        for field in msgspec.structs.fields(of)
    ]
    what = (inspect.getdoc(of) or "").split("\n\n", 1)[0].replace("\n", " ")
    return f"## [{name}]\n\n{what}\n\n| key | default | meaning |\n|---|---|---|\n" + "\n".join(rows)


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return "required"
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()  # type: ignore[operator]
    return "–" if value in ("", (), None, {}) else f"`{msgspec.json.encode(value).decode()}`"
