"""What the verbs that work on a recording have in common: which of it is meant."""

import argparse
from math import radians

from bridge.recording import Recording, load


def add_choice(verb: argparse.ArgumentParser) -> None:
    """Add what chooses from a file: its rate, and of a ward's recording the device and its boot."""
    verb.add_argument(
        "--rate-hz", type=float, metavar="HZ", help="output data rate, where the file has no times and no rate"
    )
    verb.add_argument("--device", metavar="ID", help="of a ward's recording (.mcap): whose samples")
    verb.add_argument(
        "--boot", type=int, metavar="N", help="of a ward's recording: which boot, from 1, where there are several"
    )


def recorded(given: argparse.Namespace) -> Recording:
    """The recording that was chosen."""
    return load(given.file, given.rate_hz, device=given.device, boot=given.boot)


def gyro_range(given: argparse.Namespace, recording: Recording) -> float:
    """Full-scale range, rad/s: as said, else as recorded; 0 when unknown."""
    return radians(given.range_dps) or recording.gyro_range
