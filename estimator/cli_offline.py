"""The verbs that need no ward: calibrate from a recording, and the studies."""

import argparse
import json
from collections.abc import Callable
from math import isfinite, radians
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from bridge.config import ConfigError
from bridge.console import plain_console
from bridge.wire.messages import Calibration, Verdict
from estimator import picture_file
from estimator.cli_live import add_live, live
from estimator.cli_recorded import HOLDS, add_choice, check_range, gyro_range, recorded

if TYPE_CHECKING:
    from estimator.batch.result import Result

METHODS = f"""{HOLDS}

A ward's recording (.mcap) may hold the calibration that was made of this boot while the ward ran: it is shown,
unless a method is named.

methods:
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
  truerate calibrate --live chest --config configs/ward.toml   says what to do with the device, step by step
  truerate calibrate session.npz
  truerate calibrate poses.csv --method transitions --json
  truerate calibrate table.npz --method turntable --rates-dps 30,60,90"""

_NOISE, _WOBBLE = "white noise of a reading, °/s", "wobble of the turning hand"
_WORKERS = "processes (default: one a processor)"

Verbs = argparse._SubParsersAction  # noqa: SLF001 - argparse has no public name for it


def add_verb(
    verbs: "Verbs[argparse.ArgumentParser]", name: str, run: Callable[[argparse.Namespace], int | None], help_text: str
) -> argparse.ArgumentParser:
    """Add a verb that calls run with the parsed arguments."""
    parser = verbs.add_parser(name, help=help_text, description=help_text[:1].upper() + help_text[1:] + ".")
    parser.set_defaults(run=run)
    return parser


def add_calibrate(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `calibrate FILE`."""
    verb = add_verb(
        verbs,
        "calibrate",
        _calibrate,
        "calibrate from a recording (.npz, .csv, .mcap): still, turn, still, turn, still, turn, still",
    )
    verb.epilog, verb.formatter_class = METHODS, argparse.RawDescriptionHelpFormatter
    verb.add_argument("file", type=Path, nargs="?", help="a recording, .npz, .csv or .mcap; see below")
    add_live(verb)
    verb.add_argument("--method", metavar="NAME", help="how (default: closure); see below")
    verb.add_argument(
        "--rates-dps", type=_rates, default=(), metavar="DPS,…", help="the machine's known rates in °/s, as 30,60,90"
    )
    verb.add_argument(
        "--json", action="store_true", help="one JSON object: matrix, bias_rad_s, covariance, verdict, turns …"
    )
    add_choice(verb)
    verb.add_argument(
        "--range-dps", type=float, default=0.0, metavar="DPS", help="full-scale range in °/s, to notice clipping"
    )


def add_study(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `study NAME`."""
    inner = verbs.add_parser(
        "study", help="measure the methods by simulation", description="Example: truerate study paper --runs 1000"
    ).add_subparsers(metavar="NAME", required=True)
    does = "errors of Algorithm 1 over simulated sessions, with a table and a picture"
    verb = add_verb(inner, "algorithm1", _study, does)
    verb.add_argument("--sessions", type=_at_least_one, default=200)
    verb.add_argument("--noise", type=float, default=0.03, metavar="DPS", help=_NOISE)
    verb.add_argument("--wobble", type=float, default=0.0, metavar="DEG", help=_WOBBLE)
    verb.add_argument("--picture", type=Path, default=Path("out/algorithm1.png"))
    does = "the paper's simulation: Algorithm 1 and closure against truth and the best possible"
    _add_paper(add_verb(inner, "paper", _study_paper, does))
    does = "good and bad sessions at random: is a wrong one ever accepted, a good one refused?"
    verb = add_verb(inner, "protocols", _study_protocols, does)
    verb.add_argument(
        "--runs", type=_at_least_one, default=10_000, help="good sessions, and as many bad ones (default: %(default)s)"
    )
    verb.add_argument("--method", default="closure")
    verb.add_argument("--workers", type=_at_least_one, default=None, help=_WORKERS)
    does = "how many estimators a ward needs, and how many a region"
    _add_scaling(add_verb(inner, "scaling", _study_scaling, does))


def _add_paper(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--runs", type=_at_least_one, default=15_000, help="sessions at each noise (default: %(default)s)"
    )
    verb.add_argument("--noise", type=float, nargs="+", default=[0.03, 0.15], metavar="DPS", help=_NOISE)
    verb.add_argument("--wobble", type=float, default=0.0, metavar="DEG", help=_WOBBLE)
    verb.add_argument("--replacement", type=float, default=0.0, metavar="DEG", help="misses of the hand, std per axis")
    verb.add_argument("--seed", type=int, default=1)
    verb.add_argument("--workers", type=_at_least_one, default=None, help=_WORKERS)
    verb.add_argument("--picture", type=Path, default=Path("out/paper.png"), help="the table is left beside it as JSON")


def _add_scaling(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--devices", type=_at_least_one, default=1000, help="of a ward (default: %(default)s)")
    verb.add_argument("--total", type=_at_least_one, default=100_000, help="of all wards (default: %(default)s)")
    verb.add_argument(
        "--message-us",
        type=float,
        default=150.0,
        help="µs of a core for ten samples, as `make bench-load` measures them",
    )
    verb.add_argument(
        "--router-us", type=float, default=12.0, help="the same of the router, for each message it passes on"
    )
    verb.add_argument("--known-s", type=float, default=0.1, help="s until the others know of a death (hung: 1.5)")
    verb.add_argument("--picture", type=Path, default=Path("out/scaling.png"))


def _at_least_one(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 1 on is expected")
    return number


def _rates(text: str) -> tuple[float, ...]:
    try:
        rates = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} are no rates; numbers in °/s are expected, as 30,60,90") from None
    if not all(0.1 <= rate <= 5000 for rate in rates):
        raise argparse.ArgumentTypeError(f"{text!r}: each rate is said once, without a sign, from 0.1 to 5000 °/s")
    return rates


def _calibrate(given: argparse.Namespace) -> int:
    if given.live:
        return live(given)
    if given.file is None:
        raise ConfigError("which recording? a file is needed, or --live DEVICE for one of a ward that runs")
    from estimator.batch.methods import BY_RATES  # noqa: PLC0415
    from estimator.batch.names import BY_HAND, DEFAULT  # noqa: PLC0415
    from estimator.calibration_file import of_result  # noqa: PLC0415
    from estimator.offline import calibrate  # noqa: PLC0415
    from estimator.report import as_json  # noqa: PLC0415

    method = given.method or DEFAULT
    if method not in (names := (*BY_HAND, *BY_RATES)):
        raise ConfigError(f"there is no method {method!r}; there are {', '.join(names)}")
    if bool(given.rates_dps) != (method in BY_RATES):
        raise ConfigError(
            f"{method} {'needs' if method in BY_RATES else 'takes no'} --rates-dps, the machine's known rates"
        )
    check_range(given)
    recording = recorded(given)
    if given.method is None and recording.made:
        return _show_made(recording.made[-1], as_json=given.json)
    rates = tuple(map(radians, given.rates_dps))
    result, passed_over = calibrate(recording, method, gyro_range=gyro_range(given, recording), rates=rates)
    if given.json:
        print(json.dumps(as_json(result, of_result(result, recording, gyro_range(given, recording)))))
    else:
        console = Console()
        for words in passed_over:
            console.print(f"passed over: {words}", style="dim", highlight=False)
        if isfinite(result.covariance.sum()):
            _show_parameters(console, result)
        console.print(f"{result.verdict.name.lower()} ({result.method}): {result.reason}", highlight=False)
    return 0 if result.verdict is Verdict.ACCEPTED else 1


def _show_made(calibration: Calibration, *, as_json: bool) -> int:
    """One that was made live, in the boot that was recorded."""
    from estimator.report import recorded_as_json  # noqa: PLC0415

    if as_json:
        print(json.dumps(recorded_as_json(calibration)))
        return 0
    console = plain_console()
    _show_parameters(console, calibration)
    console.print(f"accepted ({calibration.method}): {calibration.reason}", highlight=False, soft_wrap=True)
    console.print(
        f"made of this boot while the ward ran, as {calibration.id}, which is in the recording; --method NAME calibrates from "
        "the samples instead",
        highlight=False,
        soft_wrap=True,
    )
    return 0


def _show_parameters(console: Console, of: "Result | Calibration") -> None:
    from estimator.batch.result import PARAMETERS  # noqa: PLC0415
    from estimator.report import as_matrix, as_table  # noqa: PLC0415

    console.print(as_table(of))
    if len(of.parameters) > len(PARAMETERS):
        console.print(as_matrix(of))


def _study(given: argparse.Namespace) -> None:
    picture_file.check("--picture", given.picture)
    from estimator.study.algorithm1 import run  # noqa: PLC0415

    run(Console(), given.sessions, given.noise, given.wobble, given.picture)


def _study_paper(given: argparse.Namespace) -> None:
    picture_file.check("--picture", given.picture)
    from estimator.study.paper import run  # noqa: PLC0415
    from estimator.study.paper_runs import Scenario  # noqa: PLC0415

    scenario = Scenario(given.runs, tuple(given.noise), given.wobble, given.replacement, given.seed)
    run(Console(), scenario, given.workers, given.picture)


def _study_protocols(given: argparse.Namespace) -> None:
    from estimator.batch.names import BY_HAND  # noqa: PLC0415

    if given.method not in BY_HAND:
        raise ConfigError(f"there is no method {given.method!r} by hand; there are {', '.join(BY_HAND)}")
    from estimator.study.protocols import run  # noqa: PLC0415

    run(Console(), given.runs, given.method, given.workers)


def _study_scaling(given: argparse.Namespace) -> None:
    picture_file.check("--picture", given.picture)
    from estimator.study.scaling import Costs, run  # noqa: PLC0415

    costs = Costs(1e-6 * given.message_us, 1e-6 * given.router_us, given.known_s)
    run(Console(), costs, given.total, given.devices, given.picture)
