"""Verb `truerate outlet`: passes a ward's data to programs that do not use zenoh."""

import argparse
import logging
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import NamedTuple

from bridge.cli.parser import Verbs, add_group, add_verb
from bridge.cli.ward_options import add_ward
from bridge.config.schema import ConfigError
from bridge.runtime.service_manager import supervised
from bridge.runtime.signals import stopped_by_signal
from bridge.wire.keys import check_id
from estimator.cli.ward_options import ward_of

log = logging.getLogger(__name__)


class Outlet(NamedTuple):
    """Outlet in the command line: passes data to one kind of program.

    does: help text. example: a command. needs: import names of the packages that it needs, separated by blanks; the
    optional extra of truerate that installs them has the outlet's name.
    """

    does: str
    example: str
    needs: str = ""


#: each is served by the module `estimator.outlets.NAME`, which is loaded only when asked for
OUTLETS: dict[str, Outlet] = {
    "foxglove": Outlet(
        "show a ward live in Foxglove: plots, a 3D view, states",
        "truerate outlet foxglove --ward demo",
        "foxglove rosbags",
    ),
    "lsl": Outlet(
        "stream to the Lab Streaming Layer (LSL): LabRecorder and other programs of movement labs",
        "truerate outlet lsl --config configs/demo.toml --with quality",
        "pylsl",
    ),
    "mqtt": Outlet(
        "publish rates once a second, and retained statuses, to an MQTT broker, as JSON",
        "truerate outlet mqtt mqtt://127.0.0.1 --config configs/demo.toml",
        "paho",
    ),
    "ros2": Outlet(
        "publish a ward to ROS 2 nodes with rmw_zenoh: samples, poses, diagnostics",
        "truerate outlet ros2 --ward demo --ros-router tcp/127.0.0.1:7448",
        "rosbags xxhash",
    ),
}


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `outlet`, with a verb for each outlet, to the command line."""
    does = "pass a ward's corrected rates and orientation on to other programs until stopped (Ctrl-C)"
    inner = add_group(verbs, "outlet", does)
    for name, outlet in OUTLETS.items():
        verb = add_verb(inner, name, partial(_serve, name, outlet), outlet.does, f"Example: {outlet.example}")
        verb.add_argument(
            "--device",
            dest="devices",
            action="append",
            metavar="ID",
            help="device to pass on; repeatable (default: all)",
        )
        import_module(f"estimator.outlets.{name}").add_arguments(verb)
        add_ward(verb)


def _serve(name: str, outlet: Outlet, given: argparse.Namespace) -> int:
    if any(find_spec(package) is None for package in outlet.needs.split()):
        raise ConfigError(f"truerate outlet {name} needs another package: pip install 'truerate[{name}]'")
    module = import_module(f"estimator.outlets.{name}")
    ward, given.routers = ward_of(given, *(module.roles(given) if hasattr(module, "roles") else ()))
    devices = [check_id(device, "--device") for device in given.devices or ()]
    from estimator.client import Client  # noqa: PLC0415 - numpy and zenoh are slow to import

    with stopped_by_signal() as stop, supervised(), Client(given.routers, ward=ward) as client:
        heard = client.statuses().keys()
        if not heard:
            log.warning(
                "no device of ward %s is heard yet: waiting. Is this the ward's name, and does its bridge run?", ward
            )
        if unknown := set(devices) - heard:
            raise ConfigError(
                f"no device {' or '.join(sorted(unknown))} is heard in ward {ward}: `truerate devices` lists "
                "the devices that are heard"
            )
        return int(module.serve(client, devices or None, given, stop))
