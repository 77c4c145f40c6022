"""Verb `truerate qualify`: tests an installation with simulated data of known truth, and writes a report to sign."""

import argparse
import platform
import tempfile
from base64 import urlsafe_b64encode
from collections.abc import Iterator
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import PackagePath, distribution, distributions
from pathlib import Path

from bridge.cli.parser import Verbs, add_verb
from bridge.diagnose.finding import Finding, Level, ok, trouble
from bridge.runtime.os_errors import why
from bridge.toml.loader import ConfigError

_SEED = 1
_EXAMPLES = """The report has two parts. Installation: version, packages, truerate's files against their checksums, and the
checks of `truerate doctor`. Operation: six simulated devices are calibrated, tracked and rebooted, and every
result is compared with the simulator's truth. It takes about two minutes, and uses no device and no port of the
ward. Exit code 1 if a check failed.

examples:
  truerate qualify --out qualification.md
  truerate qualify /etc/truerate/ward.toml --out qualification.md"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `qualify` to the command line."""
    verb = add_verb(
        verbs,
        "qualify",
        _qualify,
        "test this installation against a known truth, and write a report to sign",
        _EXAMPLES,
    )
    verb.add_argument("config", type=Path, nargs="?", metavar="CONFIG", help="a ward file (.toml) to check as well")
    verb.add_argument("--out", type=Path, default=Path("qualification.md"), help="the report (default: %(default)s)")


def _qualify(given: argparse.Namespace) -> int:
    from rich.console import Console  # noqa: PLC0415 - slow to import

    from estimator.cli.doctor import look  # noqa: PLC0415
    from estimator.demo.run import run  # noqa: PLC0415

    begun = datetime.now(UTC)
    try:
        given.out.write_text("", "utf-8")  # a report that cannot be written is said before two minutes of work
    except OSError as error:
        raise ConfigError(f"--out {given.out}: {why(error)}") from None
    findings = list(dict.fromkeys([*_files(), *look(given.config)]))
    console = Console(record=True, width=110)
    with tempfile.TemporaryDirectory() as folder:
        operates = run(console, Path(folder) / "demo.png", _SEED)
    installed = all(finding.level is not Level.TROUBLE for finding in findings)
    given.out.write_text(
        _report(begun, findings, console.export_text(), installed=installed, operates=operates), "utf-8"
    )
    print(f"\nInstallation: {_verdict(installed)}. Operation: {_verdict(operates)}. Report: {given.out}")
    return 0 if installed and operates else 1


def _files() -> Iterator[Finding]:
    """Compare truerate's installed files with the checksums in its package."""
    package = distribution("truerate")
    listed = [file for file in package.files or () if file.hash is not None and file.suffix != ".pyc"]
    changed = [str(file) for file in listed if not _as_packaged(file)]
    if changed:
        more = f" and {len(changed) - 3} more" if len(changed) > 3 else ""
        yield trouble("files", f"changed or missing: {', '.join(changed[:3])}{more}", "install the package again")
    else:
        yield ok("files", f"truerate {package.version}: {len(listed)} files are as packaged")


def _as_packaged(file: PackagePath) -> bool:
    path = Path(str(file.locate()))
    digest = urlsafe_b64encode(sha256(path.read_bytes()).digest()).rstrip(b"=").decode() if path.is_file() else ""
    return file.hash is not None and digest == file.hash.value


def _report(begun: datetime, findings: list[Finding], operation: str, *, installed: bool, operates: bool) -> str:
    packages = sorted({(one.name.lower(), one.version) for one in distributions()})
    rows = "\n".join(f"| {one.check} | {one.level.value} | {one.said} | {one.do} |" for one in findings)
    listed = "\n".join(f"| {name} | {version} |" for name, version in packages)
    return f"""# Qualification of truerate {distribution("truerate").version}

| | |
|---|---|
| machine | {platform.node()}, {platform.platform()}, Python {platform.python_version()} |
| begun | {begun:%Y-%m-%d %H:%M:%S} UTC |
| installation | **{_verdict(installed)}** |
| operation | **{_verdict(operates)}** |

truerate is not a medical device. This report shows that the installation is complete and computes what it should.

## Installation

| check | result | found | to do |
|---|---|---|---|
{rows}

## Operation

Six simulated devices with known scale factors and biases were calibrated by three turns each and tracked; one was
rebooted (seed {_SEED}). The simulator shares no code with the estimator.

```
{operation.strip()}
```

## Packages

| package | version |
|---|---|
{listed}

## Signatures

| | name | date | signature |
|---|---|---|---|
| performed by | | | |
| reviewed by | | | |
"""


def _verdict(good: bool) -> str:  # noqa: FBT001
    return "passed" if good else "failed"
