"""Command-line verb `truerate bridge scan`: finds out which device is connected to which port."""

import argparse

from bridge.diagnose import scan_report
from bridge.diagnose.port_probe import bauds, examine
from bridge.diagnose.protocol_guess import candidates
from bridge.diagnose.serial_ports import Found, find
from bridge.drivers import registry
from bridge.terminal.console import plain_console
from bridge.transport import address

_DONE, _NOTHING = 0, 1


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Add the arguments of `truerate bridge scan` to its parser: ports, baud rates, seconds to listen."""
    verb.add_argument(
        "--port",
        action="append",
        metavar="PORT",
        help="port to listen on: /dev/..., tcp://host:port, udp://:port, file:///path; repeatable (default: all serial ports)",
    )
    verb.add_argument(
        "--baud",
        action="append",
        type=int,
        metavar="N",
        help="speed to try, bits per second; repeatable (default: the usual speeds)",
    )
    verb.add_argument(
        "--seconds",
        type=float,
        default=1.5,
        metavar="S",
        help="seconds to listen at each speed, 0.1 to 60 (default: 1.5)",
    )


def scan(args: argparse.Namespace) -> int:
    """Listen on the ports; print the devices found, advice, and tables to paste into the ward file (`truerate bridge scan`).

    Returns exit code 0 if a device is recognised, else 1. Raises ValueError for an invalid argument.
    """
    tried = candidates(registry.kinds().values())
    speeds = args.baud or bauds(tried)
    if not 0.1 <= args.seconds <= 60:
        raise ValueError(f"--seconds is {args.seconds:g}: use 0.1 to 60")
    for port in args.port or ["any"]:
        for speed in speeds:
            address.check(port, speed)
    found = [Found(port) for port in args.port] if args.port else find()
    console = plain_console()
    if not found:
        console.print(
            "No serial port found: nothing under /dev/serial/by-id, no /dev/ttyUSB* and no /dev/ttyACM*. "
            "Plug in a device with a cable that carries data, or name a port with --port."
        )
        return _NOTHING
    with plain_console(stderr=True).status("") as status:
        verdicts = [examine(each, tried, speeds, args.seconds, status.update) for each in found]
    console.print(scan_report.table(verdicts))
    for verdict in verdicts:
        if verdict.words:
            console.print(f"{verdict.found.port}: {verdict.words}", markup=False, highlight=False, soft_wrap=True)
    if not (snippet := scan_report.snippet(verdicts)):
        return _NOTHING
    console.print("\nFor the ward file:\n", highlight=False)
    console.print(snippet, markup=False, highlight=False, soft_wrap=True)
    return _DONE
