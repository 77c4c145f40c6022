"""Options of the verbs that read a recording: which device and boot, and what the file does not say."""

import argparse
from math import radians

from bridge.cli.reading_options import add_reading, reading_of
from bridge.config.schema import ConfigError
from bridge.recording import Recording, load

MAX_RANGE_DPS = 10_000
#: help text on the content of a recording
HOLDS = """recordings:
  .npz   gyro_rad_s (n, 3), and where there are accel_m_s2 (n, 3), temperature_c (n), t_s (n) or the number rate_hz.
  .csv .tsv .txt .log, also as .gz: a row a sample, as tools export them; any separator, decimal commas, lines above the
         header. Units in the columns' names (gx_dps, "Gyroscope X (deg/s)", accel_x_m_s2, t_ms), in a row below or above
         them; what the file does not say is asked for by the option's name. `truerate recording inspect FILE` shows what
         is understood of it.
  .mcap  as `truerate record` writes it.
  Times or a rate (--rate-hz) are needed; a wrong rate is a wrong scale."""


def add_choice(verb: argparse.ArgumentParser) -> None:
    """Add the options for what a file does not say, and for the device and boot of a ward's recording."""
    add_reading(verb)


def recorded(given: argparse.Namespace) -> Recording:
    """Load the recording that the arguments choose. Raises RecordingError."""
    return load(given.file, device=given.device, reading=reading_of(given))


def check_range(given: argparse.Namespace) -> None:
    """Refuse a full-scale range that no gyro has. Raises ConfigError."""
    if not 0 <= given.range_dps <= MAX_RANGE_DPS:
        raise ConfigError(f"--range-dps is {given.range_dps:g}; 0 (unknown) to {MAX_RANGE_DPS} is taken")


def gyro_range(given: argparse.Namespace, recording: Recording) -> float:
    """Return the full-scale range, rad/s: as given, else as recorded; 0 when unknown."""
    return radians(given.range_dps) or recording.gyro_range
