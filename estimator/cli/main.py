"""Main program of the command `truerate`: parses the arguments and runs one verb.

An error is one line on standard error. Exit codes: 0 done; 1 a finding, a refusal because of the data, or a failure;
2 wrong usage or an invalid ward file; 130 Ctrl-C.
"""

import argparse
import io
import logging
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from bridge.cli.parser import Parser, Version
from bridge.runtime import logs, os_errors
from bridge.toml.loader import ConfigError
from bridge.wire.refusal import Refusal
from estimator.cli.entry import INTERRUPTED

log = logging.getLogger("truerate")

#: verbs in the order of the help, by module; loading all modules takes longer than running most verbs
VERBS = {
    "estimator.cli.demo": ("demo",),
    "estimator.cli.init": ("init",),
    "bridge.cli.bridge": ("bridge",),
    "bridge.cli.router": ("router",),
    "bridge.cli.recording": ("record", "recording"),
    "bridge.cli.pki": ("pki",),
    "estimator.cli.estimator": ("estimator",),
    "estimator.cli.devices": ("devices", "status", "watch"),
    "estimator.cli.commands": ("recalibrate", "cancel", "zero-heading", "note", "forget"),
    "estimator.cli.placement": ("placement",),
    "estimator.cli.alerts": ("alerts",),
    "estimator.cli.cluster": ("cluster",),
    "estimator.cli.history": ("history",),
    "estimator.cli.store": ("store",),
    "estimator.cli.calibrate": ("calibrate",),
    "estimator.cli.correct": ("correct",),
    "estimator.cli.allan": ("allan",),
    "estimator.cli.config": ("config",),
    "estimator.cli.reload": ("reload",),
    "estimator.cli.doctor": ("doctor",),
    "estimator.cli.qualify": ("qualify",),
    "estimator.cli.dashboard": ("dashboard",),
    "estimator.cli.people": ("people",),
    "estimator.cli.outlet": ("outlet",),
    "estimator.cli.study": ("study",),
}
#: verbs that read devices, serve or keep a ward's data: they need what Windows lacks
_NOT_ON_WINDOWS = (
    "demo",
    "init",
    "bridge",
    "router",
    "pki",
    "estimator",
    "history",
    "store",
    "doctor",
    "qualify",
    "dashboard",
    "people",
)
_LOG_FORMAT = "--log-format"
#: permissions withheld from every new file and folder: files show how patients move
_PRIVATE = 0o027
#: Python's message when the system refuses another thread
_NO_THREAD = "can't start new thread"
#: what the system says when a library does not fit into memory; and our own words
_NO_ROOM = "failed to map segment"
_TOO_LITTLE = "not enough memory: raise the limit (ulimit -v), or end other programs"
_PLAIN = f"truerate: {_TOO_LITTLE}\n".encode()
EPILOG = """examples:
  truerate demo                                  run a small simulated ward for a minute
  truerate init ward-3                           set up a ward on this machine
  truerate config check configs/ward.toml        check the ward file
  truerate router --config configs/ward.toml     a ward on one machine: start router, bridge and estimator,
  truerate bridge run configs/ward.toml            each in its own terminal or service
  truerate estimator serve configs/ward.toml
  truerate devices --config configs/ward.toml    list the devices with state and reason
  truerate status --config configs/ward.toml     show which devices need a person
  truerate watch chest --config configs/ward.toml
                                                 show one device live; without a name the whole ward
  truerate record --config configs/ward.toml     record the ward into files
  truerate recording info FILE.mcap              show the content of a recording
  truerate history chest --config configs/ward.toml
                                                 show calibrations, boots, commands and bias of a device
  truerate calibrate session.npz --json          calibrate from a recording
  truerate correct day.npz corrected.npz         correct a recording
  truerate allan night.npz                       measure a device's noise from a recording at rest

exit codes: 0 done; 1 a finding, a refusal by the data or a failure; 2 wrong usage or a wrong ward file; 130 Ctrl-C"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code. arguments: words after `truerate`; None for those of this process."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that cannot show ° or ± shows a substitute
    words = sys.argv[1:] if arguments is None else arguments
    os.umask(os.umask(0o077) | _PRIVATE)
    given = argparse.Namespace(log_format=logs.TEXT)
    try:
        try:
            given = build(verb := _first(words)).parse_args(words)
            if sys.platform == "win32" and verb in _NOT_ON_WINDOWS:
                raise ConfigError(
                    f"`truerate {verb}` does not run on Windows: run it on Linux. On Windows, truerate analyses recordings and "
                    "receives the data of a ward"
                )
            logs.configure_logging(given.log_format)
            return int(given.run(given) or 0)
        finally:
            _say_all()
    except (ConfigError, Refusal) as error:
        return _failed(given, str(error.detail if isinstance(error, Refusal) else error), 2)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        return 1
    except Exception as error:
        if _is_memory(error):
            return _no_memory(given)
        if str(error) == _NO_THREAD:
            return _failed(given, "the system refuses another thread: raise the limit (ulimit -u)", 1)
        if not isinstance(error, _expected()):
            raise
        return _failed(given, os_errors.said(error), 1)


def _say_all() -> None:
    """Flush standard output. If nobody reads it, drop the rest, or Python would print an error of its own at exit."""
    try:
        if sys.stdout is not None:  # None if it was closed before the start
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


def _failed(given: argparse.Namespace, words: str, code: int) -> int:
    """Report a failure in the log's format, and return the exit code."""
    if given.log_format == logs.JSON:
        log.error("%s", words)
    else:
        print(logs.printable_lines(f"truerate: {words}").replace("\n", "\n  "), file=sys.stderr)
    return code


def _is_memory(error: BaseException) -> bool:
    """Return whether memory ran out, in Python or while a library was loaded."""
    chain = list[BaseException]()
    found: BaseException | None = error
    while found is not None and found not in chain:  # a chain may lead back to its start
        chain.append(found)
        found = found.__cause__ or found.__context__
    return any(isinstance(one, MemoryError) or _NO_ROOM in str(one) for one in chain)


def _no_memory(given: argparse.Namespace) -> int:
    try:
        return _failed(given, _TOO_LITTLE, 1)
    except MemoryError:  # there is not even enough to format this
        os.write(2, _PLAIN)
        return 1


def _expected() -> tuple[type[Exception], ...]:
    # Imported late: most commands need none of them.
    from bridge.bus.contract import BusError  # noqa: PLC0415
    from bridge.recording.error import RecordingError  # noqa: PLC0415
    from estimator.database import StoreError  # noqa: PLC0415
    from estimator.demo import DemoFailed  # noqa: PLC0415
    from estimator.offline.calibration_file import CalibrationFileError  # noqa: PLC0415

    return BusError, RecordingError, CalibrationFileError, StoreError, DemoFailed, OSError


def _first(words: Sequence[str]) -> str:
    """Return the first word that does not belong to the log format's option: the verb, or a general option."""
    left = iter(words)
    for word in left:
        if word == _LOG_FORMAT:
            next(left, "")
        elif not word.startswith(f"{_LOG_FORMAT}="):
            return word
    return ""


def build(verb: str = "") -> argparse.ArgumentParser:
    """Return the argument parser. verb: a known verb loads only the verbs of its module; any other loads all verbs."""
    parser: argparse.ArgumentParser = Parser(
        prog="truerate",
        description="Corrected angular rates, each with its standard deviation, for every wearable IMU on a ward.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=Version)
    parser.add_argument(
        _LOG_FORMAT, choices=logs.FORMATS, default=logs.TEXT, help="format of the log on standard error (default: text)"
    )
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    of_verb = [module for module, names in VERBS.items() if verb in names]
    for module in of_verb or VERBS:
        import_module(module).add_verbs(verbs)
    return parser


if __name__ == "__main__":
    sys.exit(main())
