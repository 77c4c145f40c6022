"""Options for reading a recording: facts that its file does not state, or states wrongly."""

from msgspec import Struct

from bridge.recording.error import RecordingError
from bridge.text.units import ACCEL, GYRO, TIME, unit_in


class Reading(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options for reading one file; a given option replaces what the file states.

    rate_hz: output data rate, Hz; it replaces the times.
    gyro_unit, accel_unit, time_unit: unit of the file's numbers, such as deg/s.
    gyro_sensitivity, accel_sensitivity: raw counts per °/s and per g.
    columns: names or numbers, from 1, of the gyro's x, y, z columns, optionally followed by the accelerometer's x, y,
    z. Alternatively the name of a known tool, or a .toml file that describes one.
    time_column: name or number of the time column. accel_file: path of a second file, which has the accelerations.
    device, boot: part of the recording to read: name of the device, topic, stream or sensor; number of the boot, from
    1.

    Raises RecordingError for an invalid option.
    """

    #: output data rate, Hz, for example 104; replaces the times of the file
    rate_hz: float | None = None
    #: unit of the rates in the file: `deg/s`, `rad/s` or `mdeg/s`; default: as the file says
    gyro_unit: str | None = None
    #: unit of the accelerations in the file: `g`, `m/s2` or `mg`; default: as the file says
    accel_unit: str | None = None
    #: unit of the times in the file: `s`, `ms`, `us` or `ns`; default: as the file says
    time_unit: str | None = None
    #: raw counts per °/s, for example 131, if the file holds the gyro's raw counts
    gyro_sensitivity: float | None = None
    #: raw counts per g, for example 16384, if the file holds the accelerometer's raw counts
    accel_sensitivity: float | None = None
    #: names or numbers (from 1) of the columns of the gyro's x, y, z, then of the accelerometer's x, y, z; or one tool's name
    columns: tuple[str, ...] = ()
    #: name or number (from 1) of the column with the sample times
    time_column: str | None = None
    #: second file that holds the accelerometer's samples, for example `acc.csv`
    accel_file: str | None = None
    #: device, topic, stream or sensor to read, where a recording holds several
    device: str | None = None
    #: number of the boot to play (the first is 1), if the device was switched on several times
    boot: int | None = None

    def __post_init__(self) -> None:
        for option, given, known in (
            ("--gyro-unit", self.gyro_unit, GYRO),
            ("--accel-unit", self.accel_unit, ACCEL),
            ("--time-unit", self.time_unit, TIME),
        ):
            if given is not None and unit_in(given, known) is None:
                raise RecordingError(f"{option} is {given!r}: use one of {', '.join(known)}")
        for option, counts in (
            ("--gyro-sensitivity", self.gyro_sensitivity),
            ("--accel-sensitivity", self.accel_sensitivity),
        ):
            if counts is not None and not 0 < counts < 1e9:
                raise RecordingError(f"{option} is {counts:g}: give the counts per °/s or per g, a number above 0")
        if len(self.columns) not in (0, 1, 3, 6):
            raise RecordingError(
                f"--columns names {len(self.columns)} columns: name 3 (gyro x,y,z), 6 (then accelerometer x,y,z), "
                "or one tool's name or .toml"
            )

    @property
    def gyro_factor(self) -> float | None:
        """Factor that converts the file's numbers to rad/s; None without gyro_unit and gyro_sensitivity."""
        return GYRO["deg/s"] / self.gyro_sensitivity if self.gyro_sensitivity else unit_in(self.gyro_unit or "", GYRO)

    @property
    def accel_factor(self) -> float | None:
        """Factor that converts the file's numbers to m/s²; None without accel_unit and accel_sensitivity."""
        return ACCEL["g"] / self.accel_sensitivity if self.accel_sensitivity else unit_in(self.accel_unit or "", ACCEL)

    @property
    def time_factor(self) -> float | None:
        """Factor that converts the file's times to seconds; None without time_unit."""
        return unit_in(self.time_unit or "", TIME)


#: no option: the file is read as it says
AS_SAID = Reading()


def as_table(reading: Reading) -> dict[str, object]:
    """Return the given options as a TOML table: the keys and values for a replayed device in a ward file."""
    told = {name: getattr(reading, name) for name in reading.__struct_fields__}
    return {name: value for name, value in told.items() if value not in (None, ())}
