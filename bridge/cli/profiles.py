"""Command-line verbs `truerate bridge profiles` and `try`: list text profiles, try one on a captured file."""

import argparse
import math
from pathlib import Path
from typing import Final

from bridge.diagnose.profile_trial import attempt, report
from bridge.runtime.logs import printable_lines
from bridge.terminal.console import plain_console
from bridge.terminal.plurals import count
from bridge.terminal.tables import Column, Columns
from bridge.text.profile import load_profile, shipped

#: most bytes of a captured file that are read
MAX_FILE: Final = 64_000_000
_DONE, _FAILED = 0, 1
#: the bytes of nearly all text, and their least share in it; at a wrong baud rate the share is lower
_PRINTED, _MOSTLY = frozenset(b"\t\r\n" + bytes(range(32, 127))), 0.9


def profiles(_: argparse.Namespace) -> int:
    """Print the profiles shipped with truerate, with a summary of each (`truerate bridge profiles`).

    Return exit code 0.
    """
    known = Columns([Column("profile", least=16), Column("device", least=20)], headings=False)
    for name in shipped():
        known.add(name, load_profile(name).summary)
    plain_console().print(known)
    return _DONE


def add_try(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `truerate bridge try` to its parser."""
    parser.add_argument("profile", metavar="PROFILE", help="name of a profile, or path of its .toml file")
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="captured output of the device: cat /dev/ttyACM0 > FILE"
    )
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="length of the capture in seconds; measures the rate"
    )
    parser.add_argument(
        "--rate-hz", type=float, metavar="HZ", help="output data rate in Hz, if the lines carry no time"
    )


def try_profile(args: argparse.Namespace) -> int:
    """Print what a profile reads from a captured file (`truerate bridge try`).

    Returns exit code 0 if any sample was understood, else 1. Raises ValueError for an option that is not above 0.
    """
    for option, given in (("--seconds", args.seconds), ("--rate-hz", args.rate_hz)):
        if given is not None and not 0 < given < math.inf:
            raise ValueError(f"{option} is {given:g}: use a number above 0, or leave the option out if it is unknown")
    profile = load_profile(args.profile)
    with args.file.open("rb") as file:
        data = file.read(MAX_FILE)
    trial = attempt(profile, data, args.rate_hz or 0.0)
    print(printable_lines("\n".join([f"{args.profile}: {profile.summary}", *report(trial, args.seconds or 0.0)])))
    if not trial.samples:
        print(f"\n{args.file}: {_came(data)}")
    return _DONE if trial.samples else _FAILED


def _came(data: bytes) -> str:
    """A sentence on a file without a single sample, and what to do."""
    if not data.strip():
        return (
            f"{count(len(data), 'byte')}, all blank: the device printed nothing on this port. `truerate bridge scan`"
            " listens on every port at all speeds"
        )
    printed = sum(byte in _PRINTED for byte in data)
    came = f"{count(len(data), 'byte')} in {count(len(data.splitlines()), 'line')}, but no sample"
    if printed < _MOSTLY * len(data):
        return f"{came}. Much is not text: the speed was probably wrong. Find it with `truerate bridge scan`, set it with stty"
    return f"{came}: try another profile (`truerate bridge profiles`), or capture for longer"
