"""Outlet for ROS 2: publishes a ward's samples as a node with rmw_zenoh does.

The module `node` contains the ROS 2 node; docs/ros2.md describes the outlet.
"""

import argparse
import os
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bridge.config.schema import check_endpoints
from bridge.pki.member import Role
from bridge.toml.loader import ConfigError

if TYPE_CHECKING:
    from estimator.client import Client

#: largest ROS_DOMAIN_ID
MAX_DOMAIN = 232


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Add the options of `truerate outlet ros2`."""
    verb.add_argument(
        "--domain",
        metavar="N",
        help=f"ROS domain, 0 to {MAX_DOMAIN} (default: ROS_DOMAIN_ID of the environment, else 0)",
    )
    verb.add_argument(
        "--ros-router",
        metavar="ENDPOINT",
        help="router of the ROS 2 nodes, such as tcp/127.0.0.1:7447 of rmw_zenohd (default: the ward's router)",
    )


def roles(given: argparse.Namespace) -> tuple[Role, ...]:
    """Return the roles of which the client certificate needs one.

    This is `ros2` at the ward's router; at another router any role with read access. Raises ConfigError for an invalid
    domain or endpoint.
    """
    _domain(given)
    if given.ros_router:
        try:
            check_endpoints([given.ros_router], "--ros-router")
        except ValueError as error:
            raise ConfigError(str(error)) from None
    return (Role.ROS2, Role.VIEWER, Role.COMMANDER, Role.RECORDER) if given.ros_router else (Role.ROS2,)


def _domain(given: argparse.Namespace) -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0" if given.domain is None else given.domain
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_DOMAIN):
        raise ConfigError(f"ROS domain {text!r} is not valid: use 0 to {MAX_DOMAIN}")
    return int(text)


def serve(client: "Client", devices: Sequence[str] | None, given: argparse.Namespace, stop: threading.Event) -> int:
    """Publish the ward to ROS 2 until `stop` is set; returns the exit code 0.

    devices: ids, None for all. given: parsed options. Raises BusError if the ROS 2 router does not answer.
    """
    from bridge.bus.zenoh_bus import ZenohBus  # noqa: PLC0415 - zenoh is slow to import
    from estimator.outlets.ros2.node import Ros2Outlet  # noqa: PLC0415 - needs rosbags and xxhash

    routers = [given.ros_router] if given.ros_router else given.routers
    with ZenohBus(routers) as bus:  # a session of its own, as every ROS 2 context has one
        outlet = Ros2Outlet(client, devices, bus, _domain(given))
        print(f"ROS 2: node {outlet.name} publishes in domain {_domain(given)} at {', '.join(routers)}", flush=True)  # noqa: T201
        while not stop.is_set():
            outlet.round(0.05)
    return 0
