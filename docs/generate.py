"""Reference pages generated from the code: command line, configuration, codes and metrics."""

import inspect
from collections.abc import Iterable, Iterator

import msgspec
from sphinx.pycode import ModuleAnalyzer

from bridge.bucket.bucket import S3
from bridge.bus.certificate_metric import ENDS
from bridge.cli.parser import Parser
from bridge.config.enrolment import Enrolment
from bridge.config.schema import Bridge, Bus, Router
from bridge.drivers.registry import OURS, kinds
from bridge.ingest.health import BridgeHealth
from bridge.reasons.catalogue import catalogue
from bridge.reasons.codes import Code
from bridge.recording.settings import Recorder
from bridge.runtime.health_server import MetricFamily
from estimator.cli.main import build
from estimator.config.alerts import Alerts
from estimator.config.dashboard import Dashboard, OpenId, Person
from estimator.config.schema import Estimator
from estimator.service.health import Note, ServiceHealth

TABLES = {
    "bus": Bus,
    "router": Router,
    "bridge": Bridge,
    "devices": Enrolment,
    "estimator": Estimator,
    "recorder": Recorder,
    "s3": S3,
    "alerts": Alerts,
    "dashboard": Dashboard,
    "dashboard.people": Person,
    "dashboard.openid": OpenId,
}

#: the rule for every verb
EXIT_CODES = """| exit code | meaning |
|---|---|
| 0 | done |
| 1 | done, but with a finding that needs a person; or refused because of the data: a recording, a device, the store, the bus |
| 2 | wrong usage: an option, an argument, or a file of settings (ward file, profile, certificates) that cannot be used |
| 130 | interrupted by Ctrl-C; a command that runs until you stop it ends with 0 |"""


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


def metrics() -> str:
    """Every metric of the estimator and of the bridge, as Markdown."""
    service = ServiceHealth()
    service.note(Note(time_s=0.0, connected=True, store=""))
    bridge = BridgeHealth(infos=tuple, turned_s=lambda: 0.0, connected=lambda: True)
    parts = {"Estimator": service.families(), "Bridge": bridge.families(), "Programs with a certificate": [ENDS]}
    return (
        '# Metrics\n\nSet `health` in `[estimator]` or `[bridge]`, for example `health = "127.0.0.1:9464"`. The program then '
        "answers `/metrics` in Prometheus' text format, `/healthz` and `/readyz`. "
        "`truerate_build_info` has the program's version.\n\n"
        + "\n\n".join(f"## {part}\n\n{_metric_rows(families)}" for part, families in parts.items())
        + "\n"
    )


def _metric_rows(families: Iterable[MetricFamily]) -> str:
    rows = [
        f"| `truerate_{one.name}{'_total' if one.counter else ''}` | {', '.join(one.labels)} | {one.help} |"
        for one in families
    ]
    return "| metric | labels | meaning |\n|---|---|---|\n" + "\n".join(rows)


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
