"""Installation of a ward: writes or completes ward file, certificates and folders.

A second run adds only missing parts.
"""

import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from bridge.config.schema import load
from bridge.diagnose.port_probe import Verdict
from bridge.diagnose.scan_report import snippet
from bridge.runtime.regular_file import content
from bridge.toml.loader import parsed
from estimator.config import people_file
from estimator.config.dashboard import Person
from estimator.config.schema import Ward
from estimator.installation.certificates import certify
from estimator.installation.owned_files import OwnedFiles
from estimator.installation.ward_text import Plan, completed, virtual_devices


def install(
    plan: Plan, found: Sequence[Verdict], hashed: Callable[[str], str], say: Callable[[str], None], *, dry: bool
) -> tuple[Plan, Ward, list[str]]:
    """Install a ward: write the missing parts of its ward file, certificates, folders and people.

    plan: what to install. found: results of a scan of the serial ports. say: prints what was done. dry: nothing is
    written.
    hashed: returns the hash of a new person's password; not called in a dry run.
    Returns the plan, completed by what an earlier run made; the content of the ward file; and a list of remaining
    tasks.
    Raises ConfigError if an existing ward file is invalid; ValueError or OSError if a part cannot be made.
    """
    files, path = OwnedFiles(say, dry=dry), plan.folder / "ward.toml"
    there = content(path).decode() if path.exists() else ""
    if there:
        plan = _continued(plan, load(path, Ward), path)
    if plan.bridges and not plan.hosts:
        raise ValueError("--bridge needs --host: the name or address by which the other machine reaches this one")
    text = _text(plan, there, found)
    ward = parsed(text.encode(), path, Ward)
    files.folder(plan.folder)
    files.folder(plan.data, data=True)
    files.folder(plan.data / "recordings", data=True)
    if plan.hosts:
        certify(plan, files)
    files.write(path, text)
    _people(plan, ward, files, hashed)
    return plan, ward, list(_left(plan, ward, files.changed))


def _continued(plan: Plan, before: Ward, path: Path) -> Plan:
    """Return the plan with the hosts and machines of an earlier run."""
    if before.ward != plan.ward:
        raise ValueError(
            f"{path} is of ward {before.ward!r}, not {plan.ward!r}: name ward {before.ward!r}, or another --folder"
        )
    machines = sorted(one.name for one in (plan.folder / "machines").glob("*/"))
    hosts = before.dashboard.hosts if before.dashboard.certificate else ()
    return replace(
        plan,
        hosts=tuple(dict.fromkeys((*hosts, *plan.hosts))),
        bridges=tuple(dict.fromkeys((*machines, *plan.bridges))),
    )


def _left(plan: Plan, ward: Ward, changed: Sequence[Path]) -> Iterator[str]:
    """Yield what people still have to do."""
    path = plan.folder / "ward.toml"
    if any(one.name.startswith("router.") for one in changed):
        yield "restart the router, as its certificate or its rules are new: sudo systemctl restart truerate-router"
    if not (ward.bridge and ward.bridge.devices):
        yield f"no device was found: plug one in and run this command again, or edit {path}"
    for bridge in plan.bridges:
        yield (
            f"copy {plan.machine(bridge)}/ to {plan.folder}/ on the machine of {bridge}, add its devices to ward.toml there"
            " (truerate bridge scan), and start truerate-bridge"
        )
    if plan.hosts:
        yield f"install {plan.pki / 'ca.pem'} on the tablets (docs/dashboard.md shows how)"
        yield f"back up {plan.authority}/; its ca.key makes certificates"
    yield f"check everything: truerate doctor {path}"


def _people(plan: Plan, ward: Ward, files: OwnedFiles, hashed: Callable[[str], str]) -> None:
    """Add the people that are missing to the file that lists them, which the services may write if it holds nothing else."""
    path = people_file.file_of(plan.folder / "ward.toml", ward)
    if ward.dashboard.people_file and not path.exists():
        files.write(path, people_file.empty(plan.ward), secret=True)
    known = {one.name for one in people_file.people_in(path)}
    for name, role in plan.people.items():
        if name not in known:
            files.did("add", "added", f"{role} {name}")
            if not files.dry:
                people_file.put(path, plan.ward, Person(name=name, role=role, password=hashed(name)))


def _text(plan: Plan, there: str, found: Sequence[Verdict]) -> str:
    """Return the ward file with the devices that it lacks."""
    tables: dict[str, Any] = tomllib.loads(there)
    devices = tables.get("bridge", {}).get("devices", [])
    ports = {device.get("port") for device in devices}
    new = [verdict for verdict in found if verdict.found.port not in ports]
    blocks = snippet(new, {device["id"] for device in devices})
    if plan.virtual:
        blocks = virtual_devices(plan.virtual, {device["id"] for device in devices})
    return completed(plan, there, blocks)
