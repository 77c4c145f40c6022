"""The verbs that measure the methods by simulation: `truerate study ...`."""

import argparse
from math import inf, nan
from pathlib import Path

from rich.console import Console

from bridge.cli_parser import Verbs, add_verb, seed
from bridge.config import ConfigError
from estimator import picture_file

_NOISE, _WOBBLE = "white noise of a reading, °/s", "wobble of the turning hand"
_WORKERS = "processes (default: one a processor)"


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `study NAME`."""
    inner = verbs.add_parser(
        "study", help="measure the methods by simulation", description="Example: truerate study paper --runs 1000"
    ).add_subparsers(metavar="NAME", required=True)
    does = "errors of Algorithm 1 over simulated sessions, with a table and a picture"
    verb = add_verb(inner, "algorithm1", _study, does)
    verb.add_argument("--sessions", type=_at_least_one, default=200)
    verb.add_argument("--noise", type=_above_zero, default=0.03, metavar="DPS", help=_NOISE)
    verb.add_argument("--wobble", type=_from_zero, default=0.0, metavar="DEG", help=_WOBBLE)
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
    verb.add_argument("--noise", type=_above_zero, nargs="+", default=[0.03, 0.15], metavar="DPS", help=_NOISE)
    verb.add_argument("--wobble", type=_from_zero, default=0.0, metavar="DEG", help=_WOBBLE)
    verb.add_argument(
        "--replacement", type=_from_zero, default=0.0, metavar="DEG", help="misses of the hand, std per axis"
    )
    verb.add_argument("--seed", type=seed, default=1)
    verb.add_argument("--workers", type=_at_least_one, default=None, help=_WORKERS)
    verb.add_argument("--picture", type=Path, default=Path("out/paper.png"), help="the table is left beside it as JSON")


def _add_scaling(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--devices", type=_at_least_one, default=1000, help="of a ward (default: %(default)s)")
    verb.add_argument("--total", type=_at_least_one, default=100_000, help="of all wards (default: %(default)s)")
    verb.add_argument(
        "--message-us",
        type=_above_zero,
        default=150.0,
        help="µs of a core for ten samples, as `make bench-load` measures them",
    )
    verb.add_argument(
        "--router-us", type=_above_zero, default=12.0, help="the same of the router, for each message it passes on"
    )
    verb.add_argument("--known-s", type=_from_zero, default=0.1, help="s until the others know of a death (hung: 1.0)")
    verb.add_argument("--picture", type=Path, default=Path("out/scaling.png"))


def _at_least_one(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 1 on is expected")
    return number


def _from_zero(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = nan
    if not 0 <= number < inf:
        raise argparse.ArgumentTypeError(f"{text!r}: a number from 0 on is expected")
    return number


def _above_zero(text: str) -> float:
    if not (number := _from_zero(text)):
        raise argparse.ArgumentTypeError("0: a number above 0 is expected")
    return number


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
