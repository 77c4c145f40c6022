"""Ward file texts of an installation: builds and completes them. Pure."""

from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit

from bridge.config.schema import LOCAL
from estimator.config.dashboard import PersonRole

#: the router's port; the port of the ward's page
ROUTER_PORT, PAGE_PORT = 7447, 8443


@dataclass(frozen=True, slots=True)
class Plan:
    """Plan of an installation: the ward's name, its folders, hosts, bridges and people.

    folder: for ward file and certificates. data: folder for store and recordings. virtual: number of simulated devices.
    hosts: names and addresses by which browsers and other machines reach this machine, the preferred first.
    bridges: ids of the bridges on other machines. people: roles by name.
    """

    ward: str
    folder: Path
    data: Path
    hosts: tuple[str, ...] = ()
    bridges: tuple[str, ...] = ()
    people: Mapping[str, PersonRole] = field(default_factory=dict)
    virtual: int = 0

    @property
    def pki(self) -> Path:
        """Folder with the certificates of this machine's programs."""
        return self.folder / "pki"

    @property
    def authority(self) -> Path:
        """Folder of the certificate authority, with all certificates of the ward."""
        return self.folder / "authority"

    def machine(self, bridge: str) -> Path:
        """Return the folder with the files of a bridge on another machine, to be copied there."""
        return self.folder / "machines" / bridge

    def page(self, listen: str) -> str:
        """Return the address (URL) of the ward's page for a browser.

        listen: HOST:PORT from the table [dashboard] of the ward file.
        """
        return f"https://{self.hosts[0]}:{listen.rpartition(':')[2]}/" if self.hosts else f"http://{listen}/"


def completed(plan: Plan, there: str, found: str) -> str:
    """Return the text of this machine's ward file, completed with router, estimator, page and recorder.

    there: text of the existing file, or empty; its content and comments are kept. found: TOML blocks of newly found
    devices.
    """
    path = plan.folder / "ward.toml"
    document = tomlkit.parse(there or f"# Ward {plan.ward}. After a change: truerate config check {path}\n")
    document.setdefault("ward", plan.ward)
    _set(document, "bus", **_bus(plan))
    if not plan.bridges:
        _set(document, "router", listen=[LOCAL])
    _set(document, "bridge", id="bridge-1", health="127.0.0.1:9465")
    store = str(plan.data / "ward.sqlite3")
    _set(document, "estimator", id="estimator-1", store=store, health="127.0.0.1:9464", model="generic")
    _set(document, "recorder", folder=str(plan.data / "recordings"))
    people = {} if document.get("dashboard", {}).get("people") else {"people_file": str(plan.data / "people.toml")}
    _set(document, "dashboard", **_page(plan), **people)
    text = tomlkit.dumps(document).rstrip("\n") + "\n"
    return f"{text}\n{found}\n" if found else text


def bridge_machine(plan: Plan, bridge: str) -> str:
    """Return the text of the ward file for another machine, which runs only a bridge; without devices."""
    document = tomlkit.parse(f"# Bridge {bridge} of ward {plan.ward}. Add the devices: truerate bridge scan\n")
    document["ward"] = plan.ward
    _set(document, "bus", **_bus(plan))
    _set(document, "bridge", id=bridge)
    return tomlkit.dumps(document)


def virtual_devices(number: int, there: Container[str] = ()) -> str:
    """Return the TOML blocks of `number` simulated devices, to try an installation.

    there: ids that the ward file contains already; these are left out.
    """
    block = '[[bridge.devices]]\nid = "virtual-{0}"\ndriver = "simulated"\nseed = {0}'
    return "\n\n".join(block.format(seed) for seed in range(1, number + 1) if f"virtual-{seed}" not in there)


def _bus(plan: Plan) -> dict[str, Any]:
    if not plan.bridges:
        return {"connect": [LOCAL]}
    return {"connect": [f"tls/{plan.hosts[0]}:{ROUTER_PORT}"], "pki": str(plan.pki)}


def _page(plan: Plan) -> dict[str, Any]:
    if not plan.hosts:
        return {"listen": "127.0.0.1:8090"}
    here, listen = plan.pki / f"page.{plan.ward}", f"0.0.0.0:{PAGE_PORT}"
    return {"listen": listen, "hosts": list(plan.hosts), "certificate": f"{here}.pem", "key": f"{here}.key"}


def _set(document: tomlkit.TOMLDocument, heading: str, **values: Any) -> None:
    """Complete a table. Where a certificate is new, addresses change with it."""
    table: Any = document.setdefault(heading, tomlkit.table())
    certified = any(key in values and key not in table for key in ("pki", "certificate"))
    for key, value in values.items():
        if certified or key not in table or key == "hosts":
            table[key] = value
