"""Command-line options for properties that a recording's file lacks or states wrongly: sample rate, units, columns."""

import argparse

from bridge.recording.error import RecordingError
from bridge.recording.reading import Reading
from bridge.toml.loader import ConfigError


def add_reading(verb: argparse.ArgumentParser, *, device: bool = True) -> None:
    """Add command-line options for properties that a recording's file lacks, such as sample rate, units and columns.

    The option `--boot` chooses one boot: the samples from one power-up of the device to the next.
    `reading_of` returns the parsed options. device: True also adds the option that chooses one device of a file with
    several.
    """
    told = verb.add_argument_group("properties missing or wrong in the file")
    told.add_argument("--rate-hz", type=float, metavar="HZ", help="output data rate in Hz; replaces the file's times")
    told.add_argument("--gyro-unit", metavar="UNIT", help="unit of the rates: deg/s, rad/s, mdeg/s")
    told.add_argument("--accel-unit", metavar="UNIT", help="unit of the accelerations: g, m/s2, mg")
    told.add_argument("--gyro-sensitivity", type=float, metavar="N", help="counts per °/s, if the rates are raw counts")
    told.add_argument(
        "--accel-sensitivity", type=float, metavar="N", help="counts per g, if the accelerations are raw counts"
    )
    told.add_argument("--time-unit", metavar="UNIT", help="unit of the times: s, ms, us, ns")
    told.add_argument("--time-column", metavar="NAME", help="column of the times, by name or number from 1")
    told.add_argument(
        "--columns",
        type=named,
        default=(),
        metavar="NAME,…",
        help="columns of gyro x,y,z (then accelerometer x,y,z) by name or number; or a tool named in "
        "configs/columns, or a .toml file",
    )
    told.add_argument("--accel-file", metavar="FILE", help="second file, with the accelerometer's samples")
    if device:
        told.add_argument(
            "--device", metavar="ID", help="device, topic, stream or sensor to read, if the file holds several"
        )
    told.add_argument(
        "--boot",
        type=int,
        metavar="N",
        help="number of the boot to read (the first is 1), if the device was switched on several times",
    )


def reading_of(given: argparse.Namespace) -> Reading:
    """Return the parsed options of `add_reading` as a Reading: the properties that a recording's file lacks.

    Raises ConfigError for an invalid option.
    """
    try:
        return Reading(**{name: getattr(given, name) for name in Reading.__struct_fields__ if name != "device"})
    except RecordingError as error:
        raise ConfigError(str(error)) from None


def named(columns: str) -> tuple[str, ...]:
    """Split the option `--columns` into column names: at semicolons if there are any, else at commas."""
    return tuple(name.strip() for name in columns.split(";" if ";" in columns else ",") if name.strip())
