"""Verbs `truerate study ...`: measure the errors of the calibration methods by simulation."""

import argparse
from pathlib import Path

from rich.console import Console

from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError
from estimator.cli import picture_file
from estimator.study import names

_WORKERS = "number of processes (default: one per processor)"


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verbs `study all`, `study NAME` for each study, and `study protocols` to the command line."""
    inner = verbs.add_parser(
        "study",
        help="compute the paper's tables and figures, or run another simulation",
        description="Example: truerate study all --quick",
    ).add_subparsers(metavar="NAME", required=True)
    does = "run all studies of the paper and write a report with a row for each table, figure and claim"
    everything = add_verb(inner, "all", _study_all, does)
    _add_common(everything)
    everything.add_argument(
        "--recording", type=Path, help="imucal's session for the study `real`, which is left out otherwise"
    )
    for name, does in names.STUDIES.items():
        verb = add_verb(inner, name, _study_one, does)
        verb.set_defaults(study=name)
        _add_common(verb)
        verb.add_argument("--config", default="", help="a scenario file, .toml (default: the study's own)")
        if name not in ("typical", "real"):  # these have a single session
            verb.add_argument(
                "--runs", type=_at_least_one, help="number of simulated sessions (default: from the scenario)"
            )
        if name == "real":
            verb.add_argument("--recording", type=Path, help="the session, .npz or .csv")
    does = "simulate good and bad sessions, and count wrong ones accepted and good ones refused"
    verb = add_verb(inner, "protocols", _study_protocols, does)
    verb.add_argument(
        "--runs",
        type=_at_least_one,
        default=10_000,
        help="number of good sessions, and also of bad ones (default: %(default)s)",
    )
    verb.add_argument("--method", default="closure", help="calibration method by hand (default: %(default)s)")
    verb.add_argument("--workers", type=_at_least_one, default=None, help=_WORKERS)


def _add_common(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--quick", action="store_true", help="use few runs, for a first look")
    verb.add_argument(
        "--out", type=Path, default=Path("out/study"), help="folder for results and figures (default: %(default)s)"
    )
    verb.add_argument("--workers", type=_at_least_one, default=None, help=_WORKERS)


def _at_least_one(text: str) -> int:
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"invalid number {text!r}: give a whole number, 1 or more")
    return number


def _study_one(given: argparse.Namespace) -> None:
    picture_file.check_folder("--out", given.out / given.study / "results.json")
    from estimator.study.command import run_one  # noqa: PLC0415

    run_one(
        Console(),
        given.study,
        given.out,
        config=given.config,
        runs=getattr(given, "runs", None),
        quick=given.quick,
        workers=given.workers,
        recording=getattr(given, "recording", None),
    )


def _study_all(given: argparse.Namespace) -> None:
    picture_file.check_folder("--out", given.out / "report.html")
    from estimator.study.command import run_all  # noqa: PLC0415

    run_all(Console(), given.out, quick=given.quick, workers=given.workers, recording=given.recording)


def _study_protocols(given: argparse.Namespace) -> None:
    from estimator.calibration.method_names import BY_HAND  # noqa: PLC0415

    if given.method not in BY_HAND:
        raise ConfigError(f"unknown method {given.method!r} by hand: use one of {', '.join(BY_HAND)}")
    from estimator.study.protocols import run  # noqa: PLC0415

    run(Console(), given.runs, given.method, given.workers)
