"""The command `truerate`: one verb a job. Errors are one line on standard error; 2 for wrong use, 1 for a failure."""

import argparse
import getpass
import json
import logging
import os
import secrets
import sys
from collections.abc import Callable, Sequence
from math import isfinite, radians
from pathlib import Path

from rich.console import Console

from bridge import cli as bridge_cli
from bridge.bus.contract import BusError
from bridge.config import LOCAL, ConfigError, load
from bridge.recording import RecordingError
from bridge.recording import load as load_recording
from bridge.wire.keys import check_id
from bridge.wire.messages import Verdict
from bridge.wire.refusal import Refusal

EPILOG = """examples:
  truerate demo                                  see it all work, in about a minute
  truerate config check configs/ward.toml        is the ward's file right?
  truerate router --config configs/ward.toml     the three parts of a ward on one machine:
  truerate bridge run configs/ward.toml            router, bridge and estimator,
  truerate estimator serve configs/ward.toml       each in a terminal or a service of its own
  truerate devices --config configs/ward.toml    who is there, in what state, and why
  truerate watch chest --config configs/ward.toml
  truerate calibrate session.npz --json          calibrate from a recording"""

METHODS = """methods:
  closure      (default) three full turns by hand on a table edge, one about each axis, still for 3 s between: bias and
               scale by maximum likelihood; every rest, and gravity where there is an accelerometer, has its say.
  turn360      the same session by Algorithm 1 of Wang et al. 2024: exact, but biased when the hand wobbles.
  transitions  any movements between poses, each held still for 3 s: bias, scale and misalignment from gravity before and
               after; the diagonal alone where the poses do not show the rest. Needs an accelerometer. Lay the device on each
               of its six sides, turning it by a quarter or a half between, about every axis; full turns help the scale.
  accel_aided  the classical form of it for at least nine poses, accelerometer first (Tedaldi et al. 2014).
  turntable    constant known rates, both ways, about each axis in turn, 1.5 s or more each: bias, scale, misalignment
               against the fixture. Say the rates.
  servomotor   one known rate about a vertical axis, both ways, in three mountings or more, at rest for 1.5 s before each
               spin: bias and scale. Needs an accelerometer. Say the rate.
examples:
  truerate calibrate session.npz
  truerate calibrate poses.csv --method transitions --json
  truerate calibrate table.npz --method turntable --rates-dps 30,60,90"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    parser = build()
    given = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s", stream=sys.stderr)
    try:
        return int(given.run(given) or 0)
    except (ConfigError, Refusal) as error:
        print(f"truerate: {error.detail if isinstance(error, Refusal) else error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if not isinstance(error, _expected()):
            raise
        print(f"truerate: {error}", file=sys.stderr)
        return 1


def _expected() -> tuple[type[Exception], ...]:
    # Imported late: most commands need neither the store nor the demonstration.
    from estimator.demo.ward import DemoFailed  # noqa: PLC0415
    from estimator.service.store import StoreError  # noqa: PLC0415

    return BusError, RecordingError, StoreError, DemoFailed


def build() -> argparse.ArgumentParser:
    """The parser with every verb."""
    parser = argparse.ArgumentParser(
        prog="truerate",
        description="Corrected angular rates, with an honest uncertainty, for every wearable IMU on a ward.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    verb = _verb(verbs, "demo", _demo, "a whole small ward in about a minute, judged against its own truth")
    verb.add_argument("--picture", type=Path, default=Path("out/demo.png"), help="where to leave the picture")
    verb.add_argument("--seed", type=int, default=None, help="the same seed gives the same devices (default: random)")
    bridge_cli.add_verbs(verbs)
    _add_estimator(verbs)
    verb = _verb(verbs, "devices", _devices, "every device of a running ward: state, quality, and why")
    _add_ward(verb)
    verb = _verb(verbs, "watch", _watch, "one device, live: corrected rates with their uncertainty, state and bias")
    verb.add_argument("device")
    verb.add_argument("--seconds", type=float, default=None, help="stop after so long (default: until Ctrl-C)")
    _add_ward(verb)
    for name, help_text in (
        ("recalibrate", "ask for three new turns; the old calibration stays in use until they are taken"),
        ("cancel", "stop a calibration under way; the old one stays"),
    ):
        verb = _verb(verbs, name, _command, help_text)
        verb.add_argument("device")
        verb.add_argument("--reason", default="", help="kept in the audit beside your name")
        verb.set_defaults(verb=name)
        _add_ward(verb)
    _add_calibrate(verbs)
    config = verbs.add_parser("config", help="check a ward's file").add_subparsers(metavar="VERB", required=True)
    verb = _verb(config, "check", _config_check, "is the file right? unknown keys are named with the nearest valid one")
    verb.add_argument("file", type=Path)
    _add_study(verbs)
    return parser


Verbs = argparse._SubParsersAction  # noqa: SLF001 - argparse has no public name for it


def _verb(
    verbs: "Verbs[argparse.ArgumentParser]", name: str, run: Callable[[argparse.Namespace], int | None], help_text: str
) -> argparse.ArgumentParser:
    parser = verbs.add_parser(name, help=help_text, description=help_text[:1].upper() + help_text[1:] + ".")
    parser.set_defaults(run=run)
    return parser


def _add_ward(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--config", type=Path, help="the ward's file: says the ward and the routers")
    verb.add_argument("--ward", help="the ward's name (default: the file's, else 'ward')")
    verb.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help=f"a router (default: the file's, else {LOCAL})"
    )


def _add_estimator(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    parser = verbs.add_parser("estimator", help="the estimator service")
    inner = parser.add_subparsers(metavar="VERB", required=True)
    verb = _verb(inner, "serve", _serve, "calibrate and track every device of a ward and publish corrected rates")
    verb.add_argument("config", type=Path)


def _add_calibrate(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    verb = _verb(
        verbs,
        "calibrate",
        _calibrate,
        "calibrate from a recording (.npz, .csv): still, turn, still, turn, still, turn, still",
    )
    verb.epilog, verb.formatter_class = METHODS, argparse.RawDescriptionHelpFormatter
    verb.add_argument("file", type=Path)
    verb.add_argument("--method", metavar="NAME", help="how (default: closure); see below")
    verb.add_argument(
        "--rates-dps", type=_rates, default=(), metavar="DPS,…", help="the machine's known rates in °/s, as 30,60,90"
    )
    verb.add_argument(
        "--json", action="store_true", help="one JSON object: matrix, bias_rad_s, covariance, verdict, turns …"
    )
    verb.add_argument(
        "--rate-hz", type=float, metavar="HZ", help="output data rate, where the file has no times and no rate"
    )
    verb.add_argument(
        "--range-dps", type=float, default=0.0, metavar="DPS", help="full-scale range in °/s, to notice clipping"
    )


def _add_study(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    inner = verbs.add_parser("study", help="measure the methods by simulation").add_subparsers(
        metavar="NAME", required=True
    )
    verb = _verb(
        inner, "algorithm1", _study, "errors of Algorithm 1 over simulated sessions, with a table and a picture"
    )
    verb.add_argument("--sessions", type=int, default=200)
    verb.add_argument("--noise", type=float, default=0.03, metavar="DPS", help="white noise of a reading, °/s")
    verb.add_argument("--wobble", type=float, default=0.0, metavar="DEG", help="wobble of the turning hand")
    verb.add_argument("--picture", type=Path, default=Path("out/algorithm1.png"))
    verb = _verb(
        inner,
        "paper",
        _study_paper,
        "the paper's simulation: Algorithm 1 and closure against truth and the best possible",
    )
    verb.add_argument("--runs", type=int, default=15_000, help="sessions at each noise (default: %(default)s)")
    verb.add_argument(
        "--noise", type=float, nargs="+", default=[0.03, 0.15], metavar="DPS", help="white noise of a reading, °/s"
    )
    verb.add_argument("--wobble", type=float, default=0.0, metavar="DEG", help="wobble of the turning hand")
    verb.add_argument("--replacement", type=float, default=0.0, metavar="DEG", help="misses of the hand, std per axis")
    verb.add_argument("--seed", type=int, default=1)
    verb.add_argument("--workers", type=int, default=None, help="processes (default: one a processor)")
    verb.add_argument("--picture", type=Path, default=Path("out/paper.png"), help="the table is left beside it as JSON")


def _rates(text: str) -> tuple[float, ...]:
    try:
        rates = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} are no rates; numbers in °/s are expected, as 30,60,90") from None
    if not all(0.1 <= rate <= 5000 for rate in rates):
        raise argparse.ArgumentTypeError(f"{text!r}: each rate is said once, without a sign, from 0.1 to 5000 °/s")
    return rates


def _ward_of(given: argparse.Namespace) -> tuple[str, tuple[str, ...]]:
    from estimator.config import Ward  # noqa: PLC0415

    file = load(given.config, Ward) if given.config else None
    ward = check_id(given.ward or (file.ward if file else "ward"), "ward")
    return ward, tuple(given.connect or (file.bus.connect if file else (LOCAL,)))


def _demo(given: argparse.Namespace) -> int:
    from estimator.demo.run import run  # noqa: PLC0415

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

    ward, endpoints = _ward_of(given)
    return show_devices(Console(), ward, endpoints)


def _watch(given: argparse.Namespace) -> int:
    from estimator.watch import watch  # noqa: PLC0415

    ward, endpoints = _ward_of(given)
    return watch(Console(), ward, endpoints, check_id(given.device, "device"), given.seconds)


def _command(given: argparse.Namespace) -> int:
    from estimator.client import Client  # noqa: PLC0415

    ward, endpoints = _ward_of(given)
    device = check_id(given.device, "device")
    with Client(endpoints, ward=ward) as client:
        ask = client.recalibrate if given.verb == "recalibrate" else client.cancel
        reply = ask(device, getpass.getuser(), given.reason)
    print(f"{device}: {reply.message}", file=sys.stdout if reply.accepted else sys.stderr)
    return 0 if reply.accepted else 1


def _calibrate(given: argparse.Namespace) -> int:
    from estimator.batch.methods import BY_RATES, DEFAULT  # noqa: PLC0415
    from estimator.batch.methods import METHODS as BY_HAND  # noqa: PLC0415
    from estimator.batch.result import PARAMETERS  # noqa: PLC0415
    from estimator.offline import calibrate  # noqa: PLC0415
    from estimator.report import as_json, as_matrix, as_table  # noqa: PLC0415

    method = given.method or DEFAULT
    if method not in (names := (*BY_HAND, *BY_RATES)):
        raise ConfigError(f"there is no method {method!r}; there are {', '.join(names)}")
    if bool(given.rates_dps) != (method in BY_RATES):
        raise ConfigError(
            f"{method} {'needs' if method in BY_RATES else 'takes no'} --rates-dps, the machine's known rates"
        )
    recording = load_recording(given.file, given.rate_hz)
    rates = tuple(map(radians, given.rates_dps))
    result, passed_over = calibrate(recording, method, gyro_range=radians(given.range_dps), rates=rates)
    if given.json:
        print(json.dumps(as_json(result)))
    else:
        console = Console()
        for words in passed_over:
            console.print(f"passed over: {words}", style="dim", highlight=False)
        if isfinite(result.covariance.sum()):
            console.print(as_table(result))
            if len(result.parameters) > len(PARAMETERS):
                console.print(as_matrix(result))
        console.print(f"{result.verdict.name.lower()} ({result.method}): {result.reason}", highlight=False)
    return 0 if result.verdict is Verdict.ACCEPTED else 1


def _config_check(given: argparse.Namespace) -> None:
    from estimator.config import Ward  # noqa: PLC0415

    ward = load(given.file, Ward)
    parts = [
        f"{len(ward.bridge.devices)} devices" if ward.bridge else "no bridge",
        f"estimator {ward.estimator.id}" if ward.estimator else "no estimator",
    ]
    print(f"{given.file}: right. Ward {ward.ward}: {', '.join(parts)}")


def _study(given: argparse.Namespace) -> None:
    from estimator.study.algorithm1 import run  # noqa: PLC0415

    run(Console(), given.sessions, given.noise, given.wobble, given.picture)


def _study_paper(given: argparse.Namespace) -> None:
    from estimator.study.paper import run  # noqa: PLC0415
    from estimator.study.paper_runs import Scenario  # noqa: PLC0415

    scenario = Scenario(given.runs, tuple(given.noise), given.wobble, given.replacement, given.seed)
    run(Console(), scenario, given.workers, given.picture)


if __name__ == "__main__":
    sys.exit(main())
