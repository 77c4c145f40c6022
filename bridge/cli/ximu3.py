"""Command-line verb `truerate bridge ximu3`: shows devices of a ward as x-IMU3s."""

import argparse
import logging

from bridge.bus.access_self_test import self_test
from bridge.bus.startup import wait_for_router
from bridge.cli.ward_options import add_ward, ward_of
from bridge.config.schema import Root, check
from bridge.pki.member import Role
from bridge.runtime.signals import stopped_by_signal
from bridge.virtual_ximu3.ports import ANNOUNCED_AT, REPLY_PORT, Address
from bridge.virtual_ximu3.show import MOST_DEVICES, Wanted, show

_DONE = 0
_log = logging.getLogger(__name__)


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Add the arguments of `truerate bridge ximu3`."""
    verb.add_argument(
        "--device",
        action="append",
        default=[],
        metavar="ID",
        help="device to send; repeatable (default: all devices heard)",
    )
    verb.add_argument("--raw", action="store_true", help="send raw rates instead of corrected rates")
    verb.add_argument(
        "--udp",
        default="127.0.0.1:8000",
        metavar="HOST:PORT",
        help="where to send; each further device uses the next port (default: %(default)s)",
    )
    verb.add_argument(
        "--announce",
        default="127.0.0.1",
        metavar="HOST",
        help="host or broadcast address to announce the devices to (default: 127.0.0.1)",
    )
    add_ward(verb)


def shown(args: argparse.Namespace) -> int:
    """Show the devices until stopped; raises ValueError for an invalid argument."""
    root = ward_of(args, Root)
    # accelerations are raw data, which viewers may not read
    connect = root.bus.routers_as(Role.COMMANDER, Role.RECORDER)
    devices = tuple(check(device, "--device") for device in dict.fromkeys(args.device))
    if len(devices) > MOST_DEVICES:
        raise ValueError(f"--device names {len(devices)} devices: use at most {MOST_DEVICES}")
    wanted = Wanted(
        ward=root.ward,
        devices=devices,
        corrected=not args.raw,
        to=_address(args.udp),
        announce=Address(args.announce, ANNOUNCED_AT) if args.announce else None,
    )
    with stopped_by_signal() as stop:
        bus = wait_for_router(connect, stop, patient=True)
        if bus is not None:
            with bus:
                for words in self_test(bus, connect, root.ward):
                    _log.error("%s", words)
                show(bus, wanted, stop)
    return _DONE


def _address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    highest = (1 << 16) - 1 - REPLY_PORT - MOST_DEVICES
    if not (port.isascii() and port.isdigit() and 0 < int(port) <= highest):
        raise ValueError(f"--udp {text!r}: use HOST:PORT with a port from 1 to {highest}, such as 127.0.0.1:8000")
    return Address(host or "127.0.0.1", int(port))
