"""Verb `truerate calibrate --live DEVICE`: guides a person through the calibration of a live device."""

import argparse
import os
from pathlib import Path

from bridge.config.schema import LOCAL, ConfigError, load
from bridge.pki.member import Role
from bridge.terminal.console import plain_console
from bridge.wire.keys import check_id
from estimator.cli.ward_options import person, ward_of

#: options that apply to recordings only
_OF_RECORDING = ("method", "model", "rates_dps", "range_dps", "rate_hz", "device", "boot", "json")


def add_live(verb: argparse.ArgumentParser) -> None:
    """Add the options of a live calibration to the verb `calibrate`."""
    live = verb.add_argument_group("live calibration of a device in a running ward")
    live.add_argument(
        "--live", metavar="DEVICE", help="guide a person step by step through the calibration of this device"
    )
    live.add_argument("--config", type=Path, help="the ward file: names the ward and its routers")
    live.add_argument("--ward", help="the ward's name (default: from the ward file, else 'ward')")
    live.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        help=f"a router's address (default: from the ward file, else {LOCAL})",
    )
    live.add_argument("--lang", choices=["en", "zh"], help="language of the instructions (default: the terminal's)")
    live.add_argument("--seconds", type=float, default=None, help="stop after this many seconds (default: at Ctrl-C)")


def live(given: argparse.Namespace) -> int:
    """Guide a person through the calibration of one live device; returns 0 if it is calibrated, else 1.

    Raises ConfigError for options that apply to a recording only, and for an invalid time limit.
    """
    from estimator.client import Client  # noqa: PLC0415
    from estimator.config.device_settings import treatment  # noqa: PLC0415
    from estimator.config.schema import Ward  # noqa: PLC0415
    from estimator.language.texts import chosen, texts  # noqa: PLC0415
    from estimator.terminal.guided_calibration import calibrate  # noqa: PLC0415

    if given.file is not None:
        raise ConfigError("a recording and --live DEVICE are both given: omit one of the two")
    if of_recording := [name for name in _OF_RECORDING if vars(given)[name]]:
        option = of_recording[0].replace("_", "-")
        raise ConfigError(
            f"--{option} works with a recording only: leave it out, or set it in [estimator] of the ward file for --live"
        )
    if given.seconds is not None and not given.seconds > 0:
        raise ConfigError(f"--seconds is {given.seconds:g}: give a number above 0")
    ward, routers = ward_of(given, Role.COMMANDER)
    told = load(given.config, Ward) if given.config else None
    terminal = os.environ.get("LC_ALL") or os.environ.get("LC_MESSAGES") or os.environ.get("LANG", "")
    t = texts(chosen((given.lang or "", terminal[:2])))
    with Client(routers, ward=ward) as client:
        return calibrate(
            plain_console(),
            client,
            check_id(given.live, "device"),
            person(),
            t,
            seconds=given.seconds,
            knobs=treatment(told.estimator if told else None).of(given.live),
        )
