"""Command-line verbs `truerate record` and `truerate recording ...`: record a ward; inspect, convert and repair recordings."""

import argparse
import json
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import asdict

from bridge.cli.parser import Verbs, add_group, add_verb
from bridge.cli.reading_options import add_reading, reading_of
from bridge.cli.ward_options import add_ward, ward_of
from bridge.config.schema import ConfigError, Root
from bridge.config.ward_file import WardFile
from bridge.pki.member import Role
from bridge.recording.error import RecordingError
from bridge.recording.settings import Recorder
from bridge.runtime.logs import printable
from bridge.terminal.console import plain_console
from bridge.terminal.progress import Bar
from bridge.toml.loader import options

if TYPE_CHECKING:
    from bridge.recording.recording import Recording

#: device of a recording that names none
_UNNAMED = "recorded"
#: settings of the ward's file that take effect in a running recorder
_LIVE = tuple(f"recorder.{name}" for name in ("devices", "rotate", "rotate_mb", "keep_free_mb", "keep_days", "keep_gb"))

RECORD = """Writes readings, corrected rates, status, calibrations and notes of a ward to DIR/WARD-TIME.mcap. Foxglove and
PlotJuggler plot the rates of files written with --per-sample. While recording, the name ends in .part. A power failure
loses at most the last second; `truerate recording recover` completes the file. Stop with Ctrl-C.
examples:
  truerate record --config configs/ward.toml --out recordings
  truerate record --ward demo --device chest --rotate 10min --seconds 3600
  truerate record --config configs/ward.toml --per-sample              plots in Foxglove and PlotJuggler
  truerate note chest "patient sat up" --config configs/ward.toml      mark a moment, also in the recording"""
EXPORT = """Writes one file per device and boot, with readings and corrected rates, and events.csv with boots, calibrations
and notes. `truerate calibrate` and `truerate correct` read these files; they also read the .mcap itself.
examples:
  truerate recording export ward-3-20260801T101500Z.mcap --npz out/session
  truerate recording export recordings/*.mcap --bids out/dataset --subject 01 --task ward"""


INFO = """examples:
  truerate recording info ward-3-20260801T101500Z.mcap
  truerate recording info recordings/*.mcap --json"""
RECOVER = """example:
  truerate recording recover recordings/ward-3-20260801T101500Z.mcap.part"""
INSPECT = """examples:
  truerate recording inspect session.csv
  truerate recording inspect walk.bag --device /imu/data
  truerate recording inspect log.txt --gyro-unit deg/s --rate-hz 100"""
CONVERT = """examples:
  truerate recording convert walk.xdf walk.h5 --device Gyroscope
  truerate recording convert export.csv session.npz --gyro-unit deg/s
  truerate recording convert sd-card.bin session.mcap --driver witmotion --device wrist-01
  truerate recording convert log.txt session.npz --profile openlog-artemis
  truerate recording convert ward-3-20260801T101500Z.mcap walk.sto --segment chest=torso     for OpenSim, all devices
  truerate recording convert ward-3-20260801T101500Z.mcap plots.mcap --per-sample"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the commands `record` and `recording` to the parser; each verb sets `run(args)`, which returns the exit code."""
    verb = add_verb(verbs, "record", _record, "record all data of a ward to MCAP files until stopped (Ctrl-C)", RECORD)
    add_ward(verb, "the ward file (TOML): gives the ward's name, the routers and the table [recorder]")
    verb.add_argument(
        "--out", dest="folder", metavar="DIR", help="folder of the recordings; must exist (default: recordings)"
    )
    verb.add_argument(
        "--device", dest="devices", action="append", metavar="ID", help="device to record; repeatable (default: all)"
    )
    verb.add_argument(
        "--rotate", metavar="TIME", help="begin a new file after this time: 90s, 10min, 1h, never (default: 1h)"
    )
    verb.add_argument(
        "--rotate-mb", type=float, metavar="MB", help="begin a new file at this size in MB (default: 500)"
    )
    _add_per_sample(verb)
    verb.add_argument("--keep-free-mb", type=float, metavar="MB", help="MB to leave free on the disk (default: 200)")
    verb.add_argument(
        "--keep-days",
        type=float,
        metavar="DAYS",
        help="delete finished recordings of the ward after this many days (default: never)",
    )
    verb.add_argument(
        "--keep-gb",
        type=float,
        metavar="GB",
        help="delete the oldest finished recordings of the ward beyond this many gigabytes",
    )
    verb.add_argument(
        "--wait",
        dest="wait_s",
        type=float,
        metavar="S",
        help="seconds to wait for a router and a device (default: 10)",
    )
    verb.add_argument(
        "--seconds", type=float, metavar="S", help="stop after this many seconds (default: record until Ctrl-C)"
    )

    inner = add_group(
        verbs,
        "recording",
        "inspect, convert, repair and export recordings",
        "`truerate bridge replay FILE` plays a recording. `truerate calibrate`, `correct` and `allan` also read recordings.",
    )
    verb = add_verb(
        inner,
        "info",
        _info,
        "show the devices, boots, rates, gaps, calibrations and notes; exit code 1 if a file is damaged",
        INFO,
    )
    verb.add_argument("files", type=Path, nargs="+", metavar="FILE", help="the .mcap files of one recording")
    verb.add_argument("--json", action="store_true", help="print one JSON object")

    verb = add_verb(
        inner,
        "export",
        _export,
        "write a recording as .npz, .csv or BIDS-Motion; exit code 1 if parts are unreadable",
        EXPORT,
    )
    verb.add_argument("files", type=Path, nargs="+", metavar="FILE", help="the .mcap files of one recording")
    form = verb.add_mutually_exclusive_group(required=True)
    for name in ("npz", "csv", "bids"):
        form.add_argument(f"--{name}", type=Path, metavar="DIR", help=f"write {name} files into this folder")
    verb.add_argument("--device", action="append", metavar="ID", help="device to export; repeatable (default: all)")
    verb.add_argument("--subject", default="01", help="BIDS subject, a pseudonym (default: %(default)s)")
    verb.add_argument("--session", default="", help="BIDS session (default: none)")
    verb.add_argument("--task", default="ward", help="BIDS task (default: %(default)s)")

    verb = add_verb(
        inner,
        "inspect",
        _inspect,
        "show how truerate reads a file: rate, gaps, noise, gravity, warnings",
        INSPECT,
    )
    verb.add_argument("file", type=Path, metavar="FILE", help="recording, a file or a folder: see docs/recording.md")
    add_reading(verb)
    _add_capture(verb)
    verb.add_argument("--json", action="store_true", help="print one JSON object")

    verb = add_verb(
        inner,
        "convert",
        _convert,
        "convert a recording, or bytes of a device, to .npz, .csv, .h5, .parquet or .mcap; orientations to OpenSim's .sto",
        CONVERT,
    )
    verb.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="IN",
        help="recording, or captured bytes of a device; for .sto also several recordings",
    )
    verb.add_argument(
        "out", type=Path, metavar="OUT", help="new file, .npz, .csv, .h5, .parquet, .mcap or .sto; must not exist"
    )
    verb.add_argument(
        "--segment",
        action="append",
        default=[],
        metavar="DEVICE=BODY",
        help="for .sto: body of the OpenSim model on which DEVICE is worn; repeatable",
    )
    verb.add_argument(
        "--skip", type=float, default=0.0, metavar="S", help="for .sto: seconds to leave out at the beginning"
    )
    add_reading(verb)
    _add_capture(verb)
    _add_per_sample(verb)

    verb = add_verb(
        inner, "recover", _recover, "complete a recording that was cut short, and report the losses", RECOVER
    )
    verb.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help="unfinished or damaged recording, such as ward-3-20260801T101500Z.mcap.part; this file is kept",
    )
    verb.add_argument(
        "--out", type=Path, metavar="FILE", help="new file (default: FILE without .part, or NAME.recovered.mcap)"
    )


def _add_per_sample(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--per-sample",
        action="store_true",
        default=None,
        help="write each sample also as one sensor_msgs/msg/Imu, for programs that plot (needs the extra ros)",
    )


def _add_capture(verb: argparse.ArgumentParser) -> None:
    how = verb.add_mutually_exclusive_group()
    how.add_argument(
        "--driver",
        default="",
        metavar="NAME",
        help="driver that decodes the captured bytes: native, witmotion, mtdata2, ximu3, mavlink",
    )
    how.add_argument(
        "--profile",
        default="",
        metavar="NAME",
        help="profile that reads the captured lines: a name, or the path of a .toml file",
    )


def _record(given: argparse.Namespace) -> int:
    from bridge.bucket.bucket import Bucket  # noqa: PLC0415
    from bridge.recording.record import record  # noqa: PLC0415 - only this verb needs a bus

    said = {name: getattr(given, name) for name in Recorder.__struct_fields__ if getattr(given, name, None) is not None}
    if "devices" in said:
        said["devices"] = tuple(said["devices"])

    def settings_of(root: Root) -> Recorder:
        try:
            return options({**asdict(root.recorder), **said}, Recorder)
        except ValueError as error:
            raise ConfigError(f"record: {error}") from None

    try:
        file = WardFile(given.config, Root, ("recorder", "s3"), _LIVE, settings_of) if given.config else None
        root = ward_of(given, Root)
    except ValueError as error:
        raise ConfigError(f"record: {error}") from None
    if given.seconds is not None and not given.seconds > 0:
        raise ConfigError(f"--seconds is {given.seconds:g}: use a number above 0")
    routers = root.bus.routers_as(Role.RECORDER)
    return record(
        root.ward,
        routers,
        settings_of(root),
        plain_console(stderr=True),
        seconds=given.seconds,
        connected=(lambda bus: file.answer(bus, routers, Role.RECORDER, "recorder")) if file else None,
        changed=lambda: settings_of(new) if file and (new := file.look(time.monotonic())) else None,
        bucket=Bucket(root.s3, root.ward) if root.s3 is not None and root.s3.recordings else None,
    )


def _info(given: argparse.Namespace) -> int:
    from bridge.recording.report import as_json, show  # noqa: PLC0415 - arrays and protobuf are slow to import
    from bridge.recording.survey import survey  # noqa: PLC0415

    with Bar() as bar:
        found = survey(given.files, bar.on("reading"))
    if given.json:
        print(json.dumps(as_json(found)))
    else:
        show(plain_console(), found)
    return 1 if found.trouble else 0


def _loaded(given: argparse.Namespace) -> "Recording":
    from bridge.recording.readers import load  # noqa: PLC0415

    if given.driver or given.profile:
        from bridge.drivers.capture import load_capture  # noqa: PLC0415

        return load_capture(given.file, given.driver, given.profile, reading_of(given))
    return load(given.file, device=given.device if _has_streams(given) else None, reading=reading_of(given))


def _has_streams(given: argparse.Namespace) -> bool:
    """Return whether --device chooses a stream of the file; otherwise it names the device of a new file."""
    from bridge.recording.formats.registry import format_of  # noqa: PLC0415

    return not (given.driver or given.profile) and given.file.exists() and format_of(given.file).streams


def _inspect(given: argparse.Namespace) -> None:
    from bridge.recording.inspect import findings, sentences  # noqa: PLC0415

    found = findings(_loaded(given))
    if given.json:
        print(json.dumps(found))
        return
    for line in sentences(found):
        print(printable(line))


def _convert(given: argparse.Namespace) -> None:
    from bridge.recording.convert import check_ending, convert  # noqa: PLC0415
    from bridge.recording.files import check_new  # noqa: PLC0415

    try:
        check_ending(given.out)
    except RecordingError as error:
        raise ConfigError(str(error)) from None
    check_new([given.out])
    if given.out.suffix.lower() == ".sto" and not given.per_sample:
        _opensim(given)
        return
    if len(given.files) > 1 or given.segment or given.skip:
        raise ConfigError(
            f"{given.out}: several recordings, --segment and --skip apply only to .sto: give one recording without these options"
        )
    given.file = given.files[0]
    if given.per_sample and not _per_sample(given):
        return
    recording = _loaded(given)
    begin_ns = recording.begin_ns or given.file.stat().st_mtime_ns
    device = given.device or recording.device or _UNNAMED
    if _has_streams(given):  # the name of a stream need not be an id
        device = recording.device or re.sub("[^a-z0-9]+", "-", device.lower()).strip("-")[:32] or _UNNAMED
    convert(recording, given.out, device, begin_ns, per_sample=bool(given.per_sample))
    of = "" if device == _UNNAMED else f" of {device}"
    print(
        printable(
            f"{given.out}: {len(recording):,} samples{of}, {recording.time_s[-1]:.1f} s at {recording.rate_hz:.6g} Hz"
        )
    )


def _opensim(given: argparse.Namespace) -> None:
    from bridge.recording import opensim  # noqa: PLC0415 - SciPy is slow to import

    if not given.skip >= 0.0:
        raise ConfigError(f"--skip is {given.skip:g}: give seconds, 0 or more")
    segments = dict(text.partition("=")[::2] for text in given.segment)
    for device, body in segments.items():
        if not re.fullmatch(r"\w+", body):
            raise ConfigError(f"--segment {device}={body}: give DEVICE=BODY, such as chest=torso")
    devices = [given.device] if given.device else []
    for line in opensim.convert(given.files, given.out, devices, given.boot, segments, given.skip):
        print(printable(line))


def _per_sample(given: argparse.Namespace) -> bool:
    """Add samples to a copy of a ward's recording; True if the input is something else, which is to be converted."""
    from bridge.recording.reading import AS_SAID  # noqa: PLC0415
    from bridge.recording.recover import add_per_sample  # noqa: PLC0415
    from bridge.ros import messages  # noqa: PLC0415

    if given.out.suffix.lower() != ".mcap":
        raise ConfigError(
            f"{given.out}: --per-sample messages need a .mcap file: use the ending .mcap, or omit --per-sample"
        )
    if not messages.available():
        raise ConfigError(f"--per-sample {messages.NEEDS}")
    if given.file.suffix.lower() != ".mcap" or reading_of(given) != AS_SAID:
        return True
    made = add_per_sample(given.file, given.out, given.device or "")
    for line in made.said():
        print(printable(line))
    return False


def _recover(given: argparse.Namespace) -> None:
    from bridge.recording.recover import recover  # noqa: PLC0415

    with Bar() as bar:
        recovered = recover(given.file, given.out, bar.on("recovering"))
    for line in recovered.said():
        print(printable(line))


def _export(given: argparse.Namespace) -> int:
    from bridge.recording import bids, export, stretches  # noqa: PLC0415

    try:
        session = bids.Session(given.subject, given.task, given.session)
    except RecordingError as error:
        raise ConfigError(str(error)) from None
    with Bar() as bar:
        recorded = stretches.read(given.files, tell=bar.on("reading"))
    if given.device:
        recorded = recorded.only(given.device)
    if not recorded.stretches:
        raise RecordingError(
            f"{given.files[0]}: no samples to export; `truerate recording info` shows what the file holds"
        )
    if given.bids:
        paths = bids.export_bids(recorded, given.bids, session)
    else:
        paths = export.export(recorded, given.npz or given.csv, ".npz" if given.npz else ".csv")
    for path in paths:
        print(path)
    for words in recorded.trouble:
        print(printable(f"note: {words}"))
    return 1 if recorded.trouble else 0
