"""The verbs of somebody who adds a device that prints lines: list the profiles, try one on a captured file."""

import argparse
from pathlib import Path
from typing import Final

from bridge.columns import Column, Columns
from bridge.console import plain_console
from bridge.text.profile import load_profile, shipped
from bridge.text.trial import attempt, report

MAX_FILE: Final = 64_000_000
_DONE, _FAILED = 0, 1


def profiles(_: argparse.Namespace) -> int:
    """`truerate bridge profiles`: those that come with truerate."""
    known = Columns([Column("profile", least=16), Column("of what", least=20)], headings=False)
    for name in shipped():
        known.add(name, load_profile(name).summary)
    plain_console().print(known)
    return _DONE


def add_try(parser: argparse.ArgumentParser) -> None:
    """The arguments of `truerate bridge try`."""
    parser.add_argument("profile", metavar="PROFILE", help="a profile's name, or the path of its .toml")
    parser.add_argument("file", type=Path, metavar="FILE", help="what the device printed: cat /dev/ttyACM0 > FILE")
    parser.add_argument("--seconds", type=float, default=0.0, metavar="S", help="how long it was listened to")
    parser.add_argument("--rate-hz", type=float, default=0.0, metavar="HZ", help="its rate, if it tells no time")


def try_profile(args: argparse.Namespace) -> int:
    """`truerate bridge try`: 0 if any sample was understood."""
    profile = load_profile(args.profile)
    with args.file.open("rb") as file:
        data = file.read(MAX_FILE)
    trial = attempt(profile, data, args.rate_hz)
    print("\n".join([f"{args.profile}: {profile.summary}", *report(trial, args.seconds)]))
    return _DONE if trial.samples else _FAILED
