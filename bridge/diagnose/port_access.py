"""Checks of serial ports for `truerate doctor`: if they can be opened, and if ModemManager disturbs them."""

from collections.abc import Collection, Sequence
from pathlib import Path

from bridge.diagnose.finding import Finding, ok, trouble, warning
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code
from bridge.terminal.plurals import count
from bridge.transport import serial_errors
from bridge.transport.port_holders import PROC

RULES = "configs/udev/99-truerate.rules"
_INSTALL = f"sudo cp {RULES} /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm trigger"
_RULE_FOLDERS = (Path("/etc/udev/rules.d"), Path("/run/udev/rules.d"))
_IGNORED = "ID_MM_DEVICE_IGNORE"


def usable(ports: Sequence[str]) -> list[Finding]:
    """Check if each serial port can be opened. Returns one finding for each port that cannot, or one OK finding.

    A port that a bridge is reading counts as usable.
    """
    found = []
    for port in ports:
        said = serial_errors.fault(port)
        if said is not None and said.code != Code.PORT_READ_BY_BRIDGE:
            words, _, do = english(said).partition(". ")
            found.append((warning if said.code == Code.PORT_MISSING else trouble)("serial ports", words, do))
    return found or [ok("serial ports", f"no fault at {count(len(ports), 'port')}")]


def modem_manager(proc: Path = PROC, rules: Collection[Path] = _RULE_FOLDERS) -> list[Finding]:
    """Check if ModemManager, which writes to every new port to look for modems, ignores serial devices. Returns one finding.

    proc: the folder /proc. rules: folders of udev rules.
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
