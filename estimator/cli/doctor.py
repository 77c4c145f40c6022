"""Verb `truerate doctor`: finds faults of this machine or of a ward, and advises on each."""

import argparse
import json
import os
from collections.abc import Iterable
from pathlib import Path

from rich.text import Text

from bridge.bus.access_self_test import self_test
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError, load
from bridge.config.ward_file import digest_of
from bridge.diagnose import machine, port_access
from bridge.diagnose.finding import Finding, Level, ok, trouble, warning
from bridge.diagnose.router import answers, certificate, page_certificate, renewal, router
from bridge.diagnose.serial_ports import find
from bridge.ingest import duplicate_bridges
from bridge.reasons.catalogue import english
from bridge.terminal.console import plain_console
from estimator.cli import reload
from estimator.client import Client
from estimator.config.schema import Ward
from estimator.kernels.compiled import cache_folder
from estimator.service import overload

_MARKS = {Level.OK: ("✓", "green"), Level.WARNING: ("!", "yellow"), Level.TROUBLE: ("✗", "red")}
_FINE, _TROUBLE = 0, 1


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `doctor` to the command line."""
    verb = add_verb(
        verbs,
        "doctor",
        _doctor,
        "check this machine (ports, clock, disk) and a ward, and advise on each fault",
    )
    verb.add_argument("config", type=Path, nargs="?", metavar="CONFIG", help="a ward file (.toml) to check as well")
    verb.add_argument(
        "--json",
        action="store_true",
        help="print a JSON list of objects with check, level (ok, warning, trouble), said and do",
    )


def _doctor(given: argparse.Namespace) -> int:
    findings = list(dict.fromkeys(look(given.config)))
    if given.json:
        objects = [{"check": f.check, "level": f.level.value, "said": f.said, "do": f.do} for f in findings]
        print(json.dumps(objects, indent=2))
    else:
        _show(findings)
    return _TROUBLE if any(finding.level is Level.TROUBLE for finding in findings) else _FINE


def _loops() -> Finding:
    if (folder := cache_folder()) is not None:
        return ok("loops", f"compiled kernels are kept in {folder}")
    said = "compiled kernels are not kept, so every start takes up to a minute longer"
    return warning(
        "loops", said, "set NUMBA_CACHE_DIR to a folder that truerate may write to, then `python -m estimator.kernels`"
    )


def look(path: Path | None) -> Iterable[Finding]:
    """Run all checks and yield their findings: those of this machine, then those of a ward.

    path: the ward file; None checks only this machine.
    """
    plugged = [found.port for found in find()]
    ward: Ward | None = None
    said: list[Finding] = []
    if path is not None:
        try:
            ward = load(path, Ward)
            said = [ok("config", f"{path} is valid")]
        except ConfigError as error:
            do = (
                f"correct the file, then run `truerate config check {path}`"
                if path.exists()
                else "check the file's path"
            )
            said = [trouble("config", str(error), do)]
    yield from port_access.usable(list(dict.fromkeys([*plugged, *_ports(ward)])))
    yield from port_access.modem_manager()
    yield from machine.clock(machine.clock_status())
    yield _loops()
    yield from said
    if ward is not None:
        places = _places(ward)
        yield from machine.disk(places)
        if "recordings" in places:
            yield from machine.recordings(places["recordings"])
        if ward.estimator is not None:
            yield from _store(Path(ward.estimator.store))
        yield from _privacy(path, ward)
        renew = renewal(path, ward.ward)
        if ward.dashboard.certificate:
            yield page_certificate(ward.dashboard.certificate, renew)
        yield from _bucket(ward)
        for routers in ward.bus.every():
            yield from _reached(ward, routers, digest_of(path) if path else "", renew)


def _reached(ward: Ward, routers: Routers, digest: str, renew: str) -> Iterable[Finding]:
    """Check a certificate, or that none is needed, and what the routers answer to it."""
    shown = list(certificate(routers, renew))
    yield from shown
    if any(finding.level is Level.TROUBLE for finding in shown):
        return
    reached = router(routers)
    yield from reached
    if answers(reached):
        yield from _running(ward, routers, digest)


def _store(path: Path) -> Iterable[Finding]:
    """Check the store as a starting estimator would find it; nothing if there is no store yet."""
    try:
        if not path.exists():
            return
    except PermissionError:
        yield trouble("store", f"{path}: no permission to read its folder", "run doctor as the estimator's user")
        return
    from estimator.database import Database, StoreError, set_asides  # noqa: PLC0415 - few commands need it

    for mode, verb in ((os.R_OK, "read"), (os.W_OK, "write")):
        if not os.access(path, mode):
            yield trouble(
                "store",
                f"{path}: no permission to {verb} it",
                f"give the file to the estimator's user: chown USER {path}",
            )
            return
    try:
        Database.reading(path).close()
    except StoreError as error:
        said, _, do = str(error).removeprefix("store ").partition(": ")
        yield trouble("store", said, do)
        return
    for aside in set_asides(path):
        yield warning("store", f"{aside} is a store that was damaged or replaced", "inspect the file, then remove it")
    yield ok("store", f"{path} can be read")


def _privacy(path: Path | None, ward: Ward) -> Iterable[Finding]:
    """Check whether other users of this machine can read the stored data."""
    from estimator.service.privacy import advice, exposed  # noqa: PLC0415 - as above

    if path is not None and (found := exposed(path, ward)):
        yield warning("privacy", *advice(found))


def _bucket(ward: Ward) -> Iterable[Finding]:
    """Check whether the bucket of [s3] answers, and how old its newest backup is."""
    if ward.s3 is None:
        return
    from bridge.bucket.bucket import Bucket, BucketError  # noqa: PLC0415 - as above
    from estimator.database.backups import copies_of  # noqa: PLC0415

    try:
        found = Bucket(ward.s3, ward.ward).copies(copies_of(ward.estimator.id if ward.estimator else ""))
    except (BucketError, ConfigError) as error:
        yield trouble("bucket", str(error), "check [s3] in the ward file, its keys, and the network")
        return
    said = f"newest backup of {found[0][0]:%Y-%m-%d %H:%M} UTC" if found else "the bucket has no backup yet"
    yield ok("bucket", f"{ward.s3.bucket} answers: {said}")


def _running(ward: Ward, routers: Routers, digest: str) -> Iterable[Finding]:
    """Check a running ward by its own messages."""
    with ZenohBus(routers) as bus:  # by the certificate of the file's owner, who may have no right to receive
        denied = self_test(bus, routers, ward.ward)
        statuses = Client(ward=ward.ward, bus=bus).statuses(0.5)
        running = dict(reload.asked(bus, routers, ward, digest, 0.0))
    for member, reply in running.items():
        if reply.request_id == digest and not reply.accepted:
            yield warning(
                "config", f"{member.label}: {reload.said(reply, digest)}", "correct the file, or restart the program"
            )
    for words in denied:
        said, _, do = words.partition("; ")
        yield trouble("rights", said, do)
    clashes = duplicate_bridges.found(statuses.values())
    for clash in clashes:
        yield trouble("bridges of the ward", english(clash), "stop one bridge, or remove the device from its ward file")
    for found in (*overload.found(statuses.values()), *overload.unkept(statuses.values())):
        yield trouble("estimator of the ward", english(found), "read the estimator's log")
    if statuses and not clashes:
        yield ok("bridges of the ward", "each device has one bridge")


def _ports(ward: Ward | None) -> list[str]:
    """Return the serial ports of a ward's devices."""
    devices = ward.bridge.devices if ward is not None and ward.bridge is not None else ()
    return [port for device in devices if (port := getattr(device.options, "port", "")) and "://" not in port]


def _places(ward: Ward) -> dict[str, Path]:
    """Return the folders that data is written to, by purpose."""
    places = {}
    if ward.estimator is not None:
        places["store"] = Path(ward.estimator.store).parent
    if folder := getattr(getattr(ward, "recorder", None), "folder", ""):
        places["recordings"] = Path(folder)
    return places


def _show(findings: Iterable[Finding]) -> None:
    console = plain_console()
    for finding in findings:
        mark, colour = _MARKS[finding.level]
        said = f"{finding.check}: {finding.said}"
        console.print(Text(mark, colour), said, highlight=False, soft_wrap=True)
        if finding.do:
            console.print(f"    do: {finding.do}", highlight=False, soft_wrap=True)
