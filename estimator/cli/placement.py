"""Verb `placement`: states, lists and ends placements: the body segment and the wearer of each device."""

import argparse
import json

from bridge.cli.parser import Verbs, add_device, add_group, add_verb
from bridge.cli.ward_options import add_ward
from bridge.config.schema import ConfigError
from bridge.terminal.console import plain_console
from bridge.terminal.tables import Column, Columns
from bridge.wire.messages import SEGMENTS, SIDES, Placement
from bridge.wire.placement import placement
from estimator.cli.commands import obey
from estimator.cli.ward_options import listening, person, ward_of

_ABOUT = f"""States where and by whom a device is worn, from now on until the next `set` or `end`. A placement is
optional. Pages, reports and recordings show it with the device. `truerate history DEVICE` shows all placements of a device.

segments: {", ".join(SEGMENTS)}, as bodies are called in OpenSim
(humerus: upper arm, radius: forearm, femur: thigh, tibia: shank, calcn: foot). Arms and legs take --side left or right.

examples:
  truerate placement set chest --segment torso --wearer bed-3 --config configs/ward.toml
  truerate placement set wrist --segment radius --side left --wearer P07
  truerate placement list --config configs/ward.toml
  truerate placement end chest --config configs/ward.toml"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verbs `placement set|list|end` to the command line."""
    inner = add_group(verbs, "placement", "state where and by whom a device is worn", about=_ABOUT)
    verb = add_verb(inner, "set", _set, "state where and by whom a device is worn from now on")
    add_device(verb)
    verb.add_argument("--segment", default="", metavar="SEGMENT", help=f"one of {', '.join(SEGMENTS)}")
    verb.add_argument("--side", default="", metavar="SIDE", help=" or ".join(SIDES))
    verb.add_argument(
        "--wearer", "--bed", default="", metavar="NAME", help="a bed or a pseudonym; never a patient's name"
    )
    add_ward(verb)
    verb = add_verb(inner, "list", _list, "list the devices of a running ward with their placements")
    verb.add_argument("--json", action="store_true", help="print one JSON object")
    add_ward(verb)
    verb = add_verb(inner, "end", _end, "state that nobody wears a device from now on")
    add_device(verb)
    add_ward(verb)


def _set(given: argparse.Namespace) -> int:
    worn = placement(given.segment, given.side, given.wearer)
    if not worn:
        raise ConfigError("nothing to set: give --segment, --wearer or both; `truerate placement end` ends a placement")
    return obey(given, lambda client, device: client.place(device, person(), worn))


def _end(given: argparse.Namespace) -> int:
    return obey(given, lambda client, device: client.place(device, person(), Placement()))


def _list(given: argparse.Namespace) -> int:
    from estimator.client import Client  # noqa: PLC0415
    from estimator.overview.summary import placement_as_json  # noqa: PLC0415
    from estimator.reports.history import when  # noqa: PLC0415

    ward, endpoints = ward_of(given)
    listening(given, ward)
    with Client(endpoints, ward=ward) as client:
        found = {name: status.placement for name, status in sorted(client.statuses().items())}
    if given.json:
        print(json.dumps({name: placement_as_json(one) for name, one in found.items()}))
    else:
        shown = Columns([Column("device", least=20), Column("worn", least=20), Column("since"), Column("by", spare=1)])
        for name, one in found.items():
            shown.add(name, str(one) if one else "", when(one.since_ns) if one else "", one.who if one else "")
        plain_console().print(shown, highlight=False)
    return 0 if found else 1
