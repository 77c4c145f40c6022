"""Outlet to an MQTT broker: rates once a second and retained statuses, as JSON (docs/mqtt.md).

Start reading at `add_arguments` and `serve`. `broker` keeps the connection, `messages` makes the JSON.
"""

import argparse
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.pki.member import Role
from bridge.runtime import os_errors
from bridge.toml.loader import ConfigError

if TYPE_CHECKING:
    from bridge.wire.messages import Status, WindowBatch
    from estimator.client import Client

EXAMPLE = "mqtts://ward@broker.example:8883?ca=ca.pem"


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Add the options of `truerate outlet mqtt`."""
    verb.add_argument(
        "broker",
        metavar="URL",
        help="the broker: mqtt://[USER@]HOST[:PORT], or mqtts:// for TLS, with ?ca=FILE, cert=FILE and key=FILE",
    )
    verb.add_argument(
        "--password-file", type=Path, metavar="FILE", help="file with the user's password in its first line"
    )
    verb.add_argument(
        "--hz", type=int, default=1, choices=(1, 2, 5, 10), help="messages per second and device (default: 1)"
    )
    verb.add_argument("--topic", default="truerate", metavar="T", help="first level of every topic (default: truerate)")


def roles(_: argparse.Namespace) -> tuple[Role, ...]:
    """Return the roles of which the client certificate needs one.

    These roles may receive windows (mean rates over 0.1 s).
    """
    return Role.VIEWER, Role.COMMANDER


def serve(client: "Client", devices: Sequence[str] | None, given: argparse.Namespace, stop: threading.Event) -> int:
    """Publish rates and statuses of the ward to an MQTT broker until `stop` is set; returns the exit code 0.

    devices: ids, None for all. given: parsed options. Raises ConfigError for wrong options, BusError if the broker
    cannot be used.
    """
    from estimator.outlets.mqtt.broker import Broker, address_of  # noqa: PLC0415 - optional extra
    from estimator.outlets.mqtt.messages import Decimation, status_json, summary  # noqa: PLC0415 - numpy
    from estimator.outlets.places import Places  # noqa: PLC0415

    if not given.topic or set(given.topic) & set("+#\0"):
        raise ConfigError(f"--topic is {given.topic!r}: use a topic without + and #, for example truerate")
    address = address_of(given.broker, EXAMPLE)
    top = f"{given.topic}/{client.ward}"
    decimation = Decimation(given.hz)
    statuses: dict[str, Status] = {}
    told: dict[str, tuple[object, ...]] = {}
    with Broker(address, _password(given.password_file), f"{top}/outlet") as broker:

        def leave(device: str) -> None:
            decimation.leave(device)
            statuses.pop(device, None)
            if told.pop(device, None):
                broker.publish(f"{top}/{device}/status", b"", keep=True)  # the broker keeps it no longer

        def has_place(message: "WindowBatch | Status") -> bool:
            return places.take(message.device, time.monotonic())

        places = Places(leave)
        windows, heard = client.windows(devices), client.follow(devices)
        while not stop.is_set():
            for batch in filter(has_place, windows.drain(0.2)):
                for message in decimation.take(batch):
                    broker.publish(f"{top}/{batch.device}/rate", message)
            statuses |= {status.device: status for status in filter(has_place, heard.drain())}
            if broker.came_back():
                told.clear()
            for device, status in statuses.items():
                if told.get(device) != summary(status) and broker.publish(
                    f"{top}/{device}/status", status_json(status), keep=True
                ):
                    told[device] = summary(status)
    return 0


def _password(path: Path | None) -> str | None:
    if path is None:
        return None
    try:
        return (path.read_text(encoding="utf-8").splitlines() or [""])[0]
    except OSError as error:
        raise ConfigError(f"--password-file {path}: {os_errors.why(error)}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"--password-file {path}: not UTF-8 text") from None
