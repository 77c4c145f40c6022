"""Registry of file formats: finds the reader of a recording by its file ending, or by its content."""

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from bridge.recording.error import RecordingError
from bridge.recording.reading import Reading
from bridge.recording.table import Table

#: places of an IMU's samples in the folder of a EuRoC or TUM VI sequence
EUROC_IMUS = ("mav0/imu*/data.csv", "imu*/data.csv", "data.csv")
TEXT = (".csv", ".tsv", ".txt", ".log", ".dat", ".gz")


class Format(NamedTuple):
    """File format of recordings, with the module that reads it.

    name: for messages. module: name within bridge.recording; it has `read(path, reading) -> Table`. extra: the optional
    dependency of that module; empty for none. streams: True if a file may hold several named streams, of which --device
    chooses one. whole: True if a file is read into memory at once, so that its size is limited.
    """

    name: str
    module: str
    extra: str = ""
    streams: bool = False
    whole: bool = True

    def read(self, path: Path, reading: Reading) -> Table:
        """Read a file as a Table in SI units, by the format's module.

        Raises RecordingError if the file is unusable or the module's optional package is missing.
        """
        module = _loaded(path, self)
        try:
            table: Table = module.read(path, reading)
        except RecordingError:
            raise
        except Exception as error:
            if not self.extra:
                raise
            raise RecordingError(f"{path}: not a readable {self.name}: {str(error) or type(error).__name__}") from None
        return table


WARD = Format("recording of a ward", "mcap_reader", streams=True)
ROS = Format("ROS bag", "formats.ros", "ros", streams=True, whole=False)
EUROC = Format("EuRoC or TUM VI folder", "formats.euroc", streams=True, whole=False)
BIDS = Format("BIDS-Motion file", "formats.bids", streams=True, whole=False)
XDF = Format("XDF file", "formats.xdf", "xdf", streams=True)
HDF5 = Format("HDF5 file", "formats.hdf5", "hdf5", streams=True, whole=False)
FORMATS = {
    ".npz": Format(".npz", "formats.npz"),
    ".mcap": WARD,
    **dict.fromkeys((".bag", ".db3"), ROS),
    **dict.fromkeys((".xdf", ".xdfz"), XDF),
    ".ximu3": Format("x-IMU3 file", "formats.ximu3"),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), HDF5),
    ".parquet": Format("Parquet file", "formats.parquet", "parquet"),
    ".cwa": Format("Axivity file", "formats.cwa", "cwa"),
    **dict.fromkeys(TEXT, Format("text table", "text.reader", whole=False)),
}
#: formats told by more than the last ending of a name
_BY_NAME = {"_motion.tsv": BIDS, ".xdf.gz": XDF}


def format_of(path: Path) -> Format:
    """Return the format of a recording's file or folder, by its ending or content.

    Raises RecordingError if the format is unknown.
    """
    if path.is_dir():
        return _of_folder(path)
    name, ending = path.name.lower(), path.suffix.lower()
    if named := next((format_ for end, format_ in _BY_NAME.items() if name.endswith(end)), None):
        return named
    if ending not in FORMATS:
        raise RecordingError(f"{path}: unknown ending {path.suffix!r}: give a recording in {', '.join(FORMATS)}")
    if ending == ".mcap" and _profile(path).startswith("ros"):
        return ROS
    return FORMATS[ending]


def check_extra(path: Path) -> None:
    """Check that the optional dependency of an output file's format is installed. Raises RecordingError if not."""
    if format_ := FORMATS.get(path.suffix.lower()):
        _loaded(path, format_)


def _loaded(path: Path, format_: Format) -> ModuleType:
    try:
        return import_module(f"bridge.recording.{format_.module}")
    except ModuleNotFoundError as missing:
        if not format_.extra:
            raise
        package = str(missing.name).partition(".")[0]
        raise RecordingError(
            f"{path}: {format_.name}s need the package {package}: pip install 'truerate[{format_.extra}]'"
        ) from None


def _of_folder(path: Path) -> Format:
    if (path / "metadata.yaml").is_file():
        return ROS
    if any(any(path.glob(pattern)) for pattern in EUROC_IMUS):
        return EUROC
    raise RecordingError(
        f"{path}: a folder, but neither a ROS 2 bag (metadata.yaml) nor a EuRoC or TUM VI sequence (mav0/imu0/data.csv): "
        "give the file of the recording"
    )


def _profile(path: Path) -> str:
    """Return the profile in the header of an .mcap file, such as ros2; a ward's recording has none."""
    with path.open("rb") as file:
        start = file.read(64)
    # The magic has 8 bytes, the header's opcode and length 9; then comes the profile, after its own length.
    length = int.from_bytes(start[17:21], "little")
    return start[21 : 21 + length].decode("ascii", "replace")
