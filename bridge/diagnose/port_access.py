"""Checks of serial ports: permissions, other programs that hold them, ModemManager."""

import grp
import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bridge.diagnose.finding import Finding, ok, trouble, warning
from bridge.terminal.plurals import count
from bridge.transport import serial_errors
from bridge.transport.port_holders import PROC, Holder, holders, is_bridge

RULES = "configs/udev/99-truerate.rules"
_INSTALL = f"sudo cp {RULES} /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm trigger"
_RULE_FOLDERS = (Path("/etc/udev/rules.d"), Path("/run/udev/rules.d"))
_IGNORED = "ID_MM_DEVICE_IGNORE"


@dataclass(frozen=True, slots=True)
class Me:
    """The asking user: user id, and group ids of this login."""

    uid: int
    gids: frozenset[int]


def me() -> Me:
    """Return user id and group ids of the user who runs this process."""
    return Me(os.geteuid(), frozenset({os.getegid(), *os.getgroups()}))


def permissions(ports: Iterable[str], who: Me) -> list[Finding]:
    """Check whether the user may open each serial port that exists. ports: paths."""
    there = [(port, os.stat(port)) for port in ports if os.path.exists(port)]  # noqa: PTH110, PTH116 - names, as everywhere
    closed = [(port, status) for port, status in there if not _may(status, who)]
    if not there:
        return [ok("permissions", "no serial port is plugged in")]
    if not closed:
        return [ok("permissions", f"{count(len(there), 'serial port')} can be opened")]
    groups = " ".join(sorted({_group(status.st_gid) for _, status in closed}))
    return [
        trouble(
            "permissions",
            f"{', '.join(port for port, _ in closed)}: no permission to open",
            f"sudo usermod -aG {groups} $USER, then log out and in again (a running service: restart it)",
        )
    ]


def modem_manager(proc: Path = PROC, rules: Collection[Path] = _RULE_FOLDERS) -> list[Finding]:
    """Check whether ModemManager, which writes to every new port to look for modems, leaves serial devices alone.

    proc: the /proc folder. rules: folders of udev rules.
    """
    if not any(_read(path).strip() == "ModemManager" for path in proc.glob("[0-9]*/comm")):
        return [ok("ModemManager", "does not run")]
    if any(_IGNORED in _read(rule) for folder in rules for rule in folder.glob("*.rules")):
        return [ok("ModemManager", "runs, but its rules leave serial devices alone")]
    return [
        warning(
            "ModemManager",
            "runs, and sends bytes for some seconds to every device that is plugged in",
            f"{_INSTALL}; or sudo systemctl disable --now ModemManager",
        )
    ]


def _read(path: Path) -> str:
    """Contents of a file; empty if unreadable, as of an ended process."""
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""


def busy(ports: Sequence[str], proc: Path = PROC) -> list[Finding]:
    """Check whether each serial port has at most one reader, which is a bridge.

    Only root sees other users' programs.
    """
    findings = []
    for port in ports:
        having = holders(port, proc)
        others = [holder for holder in having if not is_bridge(holder.pid, proc)]
        if others:
            findings.append(_taken(port, others))
        elif len(having) > 1:
            findings.append(
                trouble(
                    "busy ports",
                    f"{port}: {', '.join(map(str, having))} have it open, so each gets only part of the bytes",
                    f"stop all but one: kill {having[-1].pid}",
                )
            )
    return findings or [ok("busy ports", "no port is open in another program")]


def present(devices: dict[str, str]) -> list[Finding]:
    """Check whether the serial ports of the configured devices, {id: port}, exist; [] if all do."""
    missing = {device: port for device, port in devices.items() if "://" not in port and not os.path.exists(port)}  # noqa: PTH110
    wrong = {device: port for device, port in devices.items() if "://" not in port and serial_errors.no_port(port)}
    advice = "find its name with `truerate bridge scan` and put it into the ward's file"
    return [
        warning(f"device {device}", f"{port} does not exist", f"plug it in; or {advice}")
        for device, port in missing.items()
    ] + [trouble(f"device {device}", f"{port} is not a serial port", advice) for device, port in wrong.items()]


def doubled(devices: dict[str, str]) -> list[Finding]:
    """Check whether two configured devices, {id: port}, are on one serial port under two names."""
    real: dict[str, list[str]] = {}
    for device, port in devices.items():
        if "://" not in port:
            real.setdefault(os.path.realpath(port), []).append(device)
    twice = {port: names for port, names in real.items() if len(names) > 1}
    return [
        trouble(
            "ports",
            f"{' and '.join(names)} are both on {port}",
            "give each device of the ward's file a port of its own",
        )
        for port, names in twice.items()
    ] or [ok("ports", "each device has its own port" if devices else "no device of the file has a port")]


def _taken(port: str, others: list[Holder]) -> Finding:
    return trouble(
        "busy ports",
        f"{port}: {', '.join(map(str, others))} {'have' if len(others) > 1 else 'has'} it open",
        f"close it there, or kill {others[0].pid}",
    )


def _may(status: os.stat_result, who: Me) -> bool:
    if who.uid == 0:
        return True
    if status.st_uid == who.uid:
        wanted = 0o600
    elif status.st_gid in who.gids:
        wanted = 0o060
    else:
        wanted = 0o006
    return status.st_mode & wanted == wanted


def _group(gid: int) -> str:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)
