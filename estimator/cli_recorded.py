"""What the verbs that work on a recording have in common: which of it is meant."""

import argparse
from math import radians

from bridge.config import ConfigError
from bridge.recording import Recording, load

MAX_RANGE_DPS = 10_000
#: what a recording holds, for who makes one
HOLDS = """recordings:
  .npz   gyro_rad_s (n, 3), and where there are accel_m_s2 (n, 3), temperature_c (n), t_s (n) or the number rate_hz.
  .csv   a header and a row a sample; the unit is in the column's name: t_s (or t_ms, t_us), gx_dps gy_dps gz_dps (or
         gyro_x_rad_s …, gyro_x_mdps …), and where there are ax_g ay_g az_g (or accel_x_m_s2 …, ax_mg …), temperature_c.
  .mcap  as `truerate record` writes it.
  Times or a rate (--rate-hz) are needed; a wrong rate is a wrong scale."""


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


def check_range(given: argparse.Namespace) -> None:
    """Refuse a full-scale range that no gyro has; raises ConfigError."""
    if not 0 <= given.range_dps <= MAX_RANGE_DPS:
        raise ConfigError(f"--range-dps is {given.range_dps:g}; 0 (unknown) to {MAX_RANGE_DPS} is taken")


def gyro_range(given: argparse.Namespace, recording: Recording) -> float:
    """Full-scale range, rad/s: as said, else as recorded; 0 when unknown."""
    return radians(given.range_dps) or recording.gyro_range
