"""Options of the verbs that read a recording: device, boot, and facts that the file does not state."""

import argparse
from math import radians

from bridge.cli.reading_options import reading_of
from bridge.config.schema import ConfigError
from bridge.recording import Recording, load

MAX_RANGE_DPS = 10_000
#: help text on the content of a recording
HOLDS = """recordings:
  .npz   gyro_rad_s (n, 3); optional accel_m_s2 (n, 3), temperature_c (n), and t_s (n) or the number rate_hz.
  .csv .tsv .txt .log, also as .gz: one row per sample, as tools export them; any separator, decimal commas, lines above the
         header. Units stand in the columns' names (gx_dps, "Gyroscope X (deg/s)", accel_x_m_s2, t_ms), or in a row above or
         below. If a unit is missing, the error names the option to give. `truerate recording inspect FILE` shows how
         truerate reads the file.
  .mcap  as `truerate record` writes it, or as ROS 2 does.
  .bag .db3 (ROS), .xdf, .ximu3, .h5, .parquet, .cwa, *_motion.tsv (BIDS), and the folders of ROS 2 bags, EuRoC and TUM VI. If a
         file holds several devices, topics or streams, the error lists them: choose one with --device.
  The file needs times, or give --rate-hz. A wrong rate gives a wrong scale."""


def recorded(given: argparse.Namespace) -> Recording:
    """Load the recording that the arguments name, in SI units. Raises RecordingError if it cannot be used."""
    return load(given.file, device=given.device, reading=reading_of(given))


def check_range(given: argparse.Namespace) -> None:
    """Check the option --range-dps, full-scale range in °/s. Raises ConfigError unless it is 0 to MAX_RANGE_DPS."""
    if not 0 <= given.range_dps <= MAX_RANGE_DPS:
        raise ConfigError(f"--range-dps is {given.range_dps:g}: give 0 (unknown) to {MAX_RANGE_DPS}")


def gyro_range(given: argparse.Namespace, recording: Recording) -> float:
    """Return the full-scale range, rad/s: the given one, else the recorded one; 0 if unknown."""
    return radians(given.range_dps) or recording.gyro_range
