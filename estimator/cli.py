"""The command `truerate`: one verb a job. Errors are one line on standard error; 2 for wrong use, 1 for a failure."""

import argparse
import getpass
import io
import logging
import os
import secrets
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from rich.console import Console

from bridge import captures, cli_pki, logs, os_words, together
from bridge import cli as bridge_cli
from bridge.bus import router_check
from bridge.bus.contract import BusError
from bridge.cli_parser import Parser
from bridge.config import ConfigError, load
from bridge.console import plain_console
from bridge.pki.member import Role
from bridge.record import cli as record_cli
from bridge.recording import RecordingError
from bridge.wire.checks import MAX_SENTENCE
from bridge.wire.keys import check_id
from bridge.wire.messages import CommandReply
from bridge.wire.refusal import Refusal
from bridge.wording import count
from estimator import (
    cli_cluster,
    cli_correct,
    cli_dashboard,
    cli_doctor,
    cli_offline,
    cli_store,
    cli_tracking,
    command,
    picture_file,
)
from estimator.cli_offline import Verbs, add_verb
from estimator.cli_ward import add_ward, ward_of

log = logging.getLogger("truerate")

EPILOG = """examples:
  truerate demo                                  see it all work, in about a minute
  truerate config check configs/ward.toml        is the ward's file right?
  truerate router --config configs/ward.toml     the three parts of a ward on one machine:
  truerate bridge run configs/ward.toml            router, bridge and estimator,
  truerate estimator serve configs/ward.toml       each in a terminal or a service of its own
  truerate devices --config configs/ward.toml    who is there, in what state, and why
  truerate status --config configs/ward.toml     is anything wrong?
  truerate watch --config configs/ward.toml      the same, live, those that need somebody first; or one: watch chest
  truerate record --config configs/ward.toml     all that the ward says, into files
  truerate recording info FILE.mcap              what is in one
  truerate history chest --config configs/ward.toml
                                                 its calibrations, boots, commands and bias so far
  truerate calibrate session.npz --json          calibrate from a recording
  truerate correct day.npz corrected.npz         correct a recording
  truerate allan night.npz                       the noise of a device, from a recording at rest"""

_ONLY = "devices in this state (degraded, awaiting-still …), or with this id (* and ? stand for anything); may be given again"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that cannot show ° or ± shows something else
    parser = build()
    given = parser.parse_args(arguments)
    logs.begin(given.log_format)
    try:
        command.interruptible()
        return int(given.run(given) or 0)
    except (ConfigError, Refusal) as error:
        return _failed(given, str(error.detail if isinstance(error, Refusal) else error), 2)
    except KeyboardInterrupt:
        return command.INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if not isinstance(error, _expected()):
            raise
        return _failed(given, os_words.said(error), 1)


def _failed(given: argparse.Namespace, words: str, code: int) -> int:
    """Say why it ends, as the log is written."""
    if given.log_format == logs.JSON:
        log.error("%s", words)
    else:
        print(logs.printable_lines(f"truerate: {words}").replace("\n", "\n  "), file=sys.stderr)
    return code


def _expected() -> tuple[type[Exception], ...]:
    # Imported late: most commands need neither the store nor the demonstration.
    from estimator.calibration_file import CalibrationFileError  # noqa: PLC0415
    from estimator.database import StoreError  # noqa: PLC0415
    from estimator.demo.ward import DemoFailed  # noqa: PLC0415

    return BusError, RecordingError, CalibrationFileError, StoreError, DemoFailed, OSError


def build() -> argparse.ArgumentParser:
    """The parser with every verb."""
    parser: argparse.ArgumentParser = Parser(
        prog="truerate",
        description="Corrected angular rates, with an honest uncertainty, for every wearable IMU on a ward.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"truerate {version('truerate')}")
    parser.add_argument(
        "--log-format", choices=logs.FORMATS, default=logs.TEXT, help="of the log on standard error (default: text)"
    )
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    verb = add_verb(verbs, "demo", _demo, "a whole small ward in about a minute, judged against its own truth")
    verb.add_argument("--picture", type=Path, default=Path("out/demo.png"), help="where to leave the picture")
    verb.add_argument("--seed", type=int, default=None, help="the same seed gives the same devices (default: random)")
    bridge_cli.add_verbs(verbs)
    record_cli.add_verbs(verbs)
    cli_pki.add_verbs(verbs)
    _add_estimator(verbs)
    verb = add_verb(verbs, "devices", _devices, "every device of a running ward: state, quality, and why")
    add_ward(verb)
    verb = add_verb(
        verbs, "status", _status, "a ward at one look: who needs a person first; the exit code tells trouble"
    )
    verb.add_argument("--json", action="store_true", help="one JSON object in place of words")
    add_ward(verb)
    verb = add_verb(
        verbs, "watch", _watch, "a ward, live, those that need a person first; or one device's rates and bias"
    )
    verb.add_argument("device", nargs="?", help="its id, as `truerate devices` shows it (default: the whole ward)")
    verb.add_argument("--only", action="append", default=[], metavar="STATE|ID", help=_ONLY)
    verb.add_argument("--once", action="store_true", help="the ward as it is now")
    verb.add_argument("--json", action="store_true", help="a JSON object a line: one a second, or with --once one")
    verb.add_argument("--seconds", type=float, default=None, help="stop after so long (default: until Ctrl-C)")
    add_ward(verb)
    for name, help_text in (
        ("recalibrate", "ask for three new turns; the old calibration stays in use until they are taken"),
        ("cancel", "stop a calibration under way; the old one stays"),
    ):
        verb = add_verb(verbs, name, _command, help_text)
        verb.add_argument("device", help="its id, as `truerate devices` shows it")
        verb.add_argument("--reason", default="", help="kept in the audit beside your name")
        verb.set_defaults(verb=name)
        add_ward(verb)
    verb = add_verb(
        verbs, "note", _note, "mark this moment of a device: it is kept, and in every recording of the ward"
    )
    verb.add_argument("device", help="its id, as `truerate devices` shows it")
    verb.add_argument("text", help="what happened, in quotes: pseudonyms only, never a patient's name")
    add_ward(verb)
    cli_cluster.add_cluster(verbs)
    cli_store.add_store(verbs)
    cli_offline.add_calibrate(verbs)
    cli_correct.add_correct(verbs)
    cli_tracking.add_allan(verbs)
    config = verbs.add_parser(
        "config", help="check a ward's file", description="Example: truerate config check configs/demo.toml"
    ).add_subparsers(metavar="VERB", required=True)
    verb = add_verb(
        config, "check", _config_check, "is the file right? unknown keys are named with the nearest valid one"
    )
    verb.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="the ward's TOML file, such as configs/demo.toml; with others of the ward and routers' .json5: do they go together?",
    )
    cli_doctor.add_doctor(verbs)
    cli_dashboard.add_dashboard(verbs)
    cli_offline.add_study(verbs)
    return parser


def _add_estimator(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    parser = verbs.add_parser(
        "estimator", help="the estimator service", description="Example: truerate estimator serve configs/demo.toml"
    )
    inner = parser.add_subparsers(metavar="VERB", required=True)
    verb = add_verb(inner, "serve", _serve, "calibrate and track every device of a ward and publish corrected rates")
    verb.add_argument("config", type=Path, help="the ward's TOML file, such as configs/demo.toml")


def _demo(given: argparse.Namespace) -> int:
    from estimator.demo.run import run  # noqa: PLC0415

    picture_file.check("--picture", given.picture)
    seed = secrets.randbelow(2**31) if given.seed is None else given.seed
    return 0 if run(Console(), given.picture, seed) else 1


def _serve(given: argparse.Namespace) -> None:
    from estimator.config import Ward  # noqa: PLC0415
    from estimator.service.serve import run  # noqa: PLC0415

    ward = load(given.config, Ward)
    if ward.estimator is None:
        raise ConfigError(f"{given.config}: there is no [estimator] table, so there is nothing to serve")
    run(ward)


def _devices(given: argparse.Namespace) -> int:
    from estimator.watch import show_devices  # noqa: PLC0415

    ward, endpoints = ward_of(given)
    return show_devices(plain_console(), ward, endpoints)


def _status(given: argparse.Namespace) -> int:
    from estimator.watch import show_status  # noqa: PLC0415

    ward, endpoints = ward_of(given)
    return show_status(plain_console(), ward, endpoints, as_json=given.json)


def _watch(given: argparse.Namespace) -> int:
    ward, endpoints = ward_of(given)
    if given.seconds is not None and not given.seconds > 0:
        raise ConfigError(f"--seconds is {given.seconds:g}; more than 0 is taken")
    if given.device is not None and not (given.only or given.once or given.json):
        from estimator.watch import watch  # noqa: PLC0415

        return watch(plain_console(), ward, endpoints, check_id(given.device, "device"), given.seconds)
    from estimator.client import Client  # noqa: PLC0415
    from estimator.watch_ward import watch_ward  # noqa: PLC0415

    only = [*given.only, *([check_id(given.device, "device")] if given.device is not None else [])]
    with Client(endpoints, ward=ward) as client:
        return watch_ward(plain_console(), client, only, once=given.once, as_json=given.json, seconds=given.seconds)


def _command(given: argparse.Namespace) -> int:
    from estimator.client import Client  # noqa: PLC0415

    ward, endpoints = ward_of(given, Role.COMMANDER)
    device = check_id(given.device, "device")
    with Client(endpoints, ward=ward) as client:
        ask = client.recalibrate if given.verb == "recalibrate" else client.cancel
        reply = ask(device, getpass.getuser(), given.reason)
    return _answered(device, reply)


def _answered(device: str, reply: CommandReply) -> int:
    """Print what the estimator answered, with the device where it does not begin with it; the exit code."""
    named = device in reply.message.split()[:2]
    print(reply.message if named else f"{device}: {reply.message}", file=sys.stdout if reply.accepted else sys.stderr)
    return 0 if reply.accepted else 1


def _note(given: argparse.Namespace) -> int:
    from estimator.client import Client  # noqa: PLC0415

    ward, endpoints = ward_of(given, Role.COMMANDER)
    device, text = check_id(given.device, "device"), given.text.strip()
    if not text:
        raise ConfigError(f'a note needs words, such as: truerate note {device} "sat up"')
    if len(text) > MAX_SENTENCE:
        raise ConfigError(f"the note has {len(text)} characters; at most {MAX_SENTENCE} are kept: make two of it")
    with Client(endpoints, ward=ward) as client:
        reply = client.note(device, getpass.getuser(), text)
    return _answered(device, reply)


def _config_check(given: argparse.Namespace) -> None:
    from estimator.config import Ward  # noqa: PLC0415

    wards, routers, wrong = {}, [], list[str]()
    for file in given.files:
        if file.suffix in (".json5", ".json"):
            try:
                routers.append(router_check.read(file))
            except BusError as error:
                wrong.append(str(error))
        else:
            wards[file] = ward = load(file, Ward)
            wrong += [f"{file}: {words}" for words in captures.unreadable(ward.bridge.devices if ward.bridge else ())]
    # Of a router that cannot be read it is not known what the others would lack.
    wrong += together.faults(wards, routers if len(routers) + len(wards) == len(given.files) else [], datetime.now(UTC))
    if wrong:
        raise ConfigError("\n".join(wrong))
    for file, ward in wards.items():
        parts = [
            count(len(ward.bridge.devices), "device") if ward.bridge else "no bridge",
            f"estimator {ward.estimator.id}" if ward.estimator else "no estimator",
        ]
        print(f"{file}: right. Ward {ward.ward}: {', '.join(parts)}")
    for words in together.soon(wards, routers):
        print(words)
    for router in routers:
        print(f"{router.path}: right. A router at {', '.join(router.listen)}, {count(len(router.members), 'member')}")


if __name__ == "__main__":
    sys.exit(main())
