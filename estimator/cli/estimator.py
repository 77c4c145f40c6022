"""Verb `truerate estimator serve`: runs the estimator service of a ward."""

import argparse
import os
from pathlib import Path

from bridge.cli.parser import Verbs, add_verb
from bridge.config.ward_file import WardFile
from bridge.toml.loader import ConfigError


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `estimator serve` to the command line."""
    parser = verbs.add_parser(
        "estimator", help="run the estimator service", description="Example: truerate estimator serve configs/demo.toml"
    )
    inner = parser.add_subparsers(metavar="VERB", required=True)
    verb = add_verb(inner, "serve", _serve, "calibrate and track every device of a ward and publish corrected rates")
    verb.add_argument("config", type=Path, help="the ward file, for example configs/demo.toml")


def _serve(given: argparse.Namespace) -> None:
    # The matrices are too small for a second thread; by default NumPy and SciPy start one per core.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from estimator.alerts.sender import by_apprise  # noqa: PLC0415
    from estimator.config.schema import Ward  # noqa: PLC0415
    from estimator.service.serve import LIVE, run  # noqa: PLC0415

    def check(ward: Ward) -> None:
        if ward.estimator is None:
            raise ConfigError(
                f'{given.config}: no [estimator] table; add one with an id, for example id = "estimator-1"'
            )
        by_apprise(ward.alerts.urls())

    file = WardFile(given.config, Ward, ("devices", "estimator", "alerts", "s3"), LIVE, check)
    run(file.root, file)
