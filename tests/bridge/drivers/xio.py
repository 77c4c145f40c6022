"""x-io's own programs, from their package: what they make of bytes, and of a device on the network."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import ximu3

Row = tuple[int, tuple[float, ...]]


class Heard(NamedTuple):
    """What was received: time in µs and numbers of each message, texts, errors in x-io's words."""

    inertial: list[Row]
    temperature: list[Row]
    battery: list[Row]
    texts: list[tuple[int, str]]
    errors: list[str]


def listen(connection: ximu3.Connection) -> Heard:
    """Collect all that a connection receives, from now on."""
    heard = Heard([], [], [], [], [])
    connection.add_inertial_callback(
        lambda m: heard.inertial.append(
            (
                m.timestamp,
                (m.gyroscope_x, m.gyroscope_y, m.gyroscope_z, m.accelerometer_x, m.accelerometer_y, m.accelerometer_z),
            )
        )
    )
    connection.add_temperature_callback(lambda m: heard.temperature.append((m.timestamp, (m.temperature,))))
    connection.add_battery_callback(
        lambda m: heard.battery.append((m.timestamp, (m.percentage, m.voltage, m.charging_status)))
    )
    connection.add_notification_callback(lambda m: heard.texts.append((m.timestamp, m.string)))
    connection.add_error_callback(lambda m: heard.texts.append((m.timestamp, m.string)))
    connection.add_receive_error_callback(lambda error: heard.errors.append(ximu3.receive_error_to_string(error)))
    return heard


def read(data: bytes, folder: Path) -> Heard:
    """What x-io's reader makes of a file of these bytes."""
    file = folder / "stream.ximu3"
    file.write_bytes(data)
    connection = ximu3.Connection(ximu3.FileConnectionConfig(str(file)))
    heard = listen(connection)
    connection.open()
    until(lambda: connection.get_status() != ximu3.CONNECTION_STATUS_CONNECTED)
    connection.close()
    return heard


def until(true: Callable[[], bool], limit_s: float = 60.0) -> None:
    """Wait until it is true."""
    end = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.005)
