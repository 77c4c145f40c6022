"""Options that name an estimator's store, and the paths that follow from them."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.config.schema import ConfigError, load

if TYPE_CHECKING:
    from estimator.database import Backups


def add_store(verb: argparse.ArgumentParser) -> None:
    """Add the options --config and --store, which name an estimator's store."""
    verb.add_argument("--config", type=Path, help="the ward file: gives the store's path")
    verb.add_argument(
        "--store",
        type=Path,
        metavar="FILE",
        help="the store's path (default: from the ward file, else truerate.sqlite3)",
    )


def backups_of(given: argparse.Namespace) -> "Backups":
    """Return the paths of the store and its backups, from the options and the ward file.

    Raises ConfigError for an invalid ward file, or one without [estimator].
    """
    from estimator.config.schema import Estimator, Ward  # noqa: PLC0415
    from estimator.database import Backups  # noqa: PLC0415

    if given.config is None:
        return Backups.of(given.store or Estimator(id="any").store)
    ward = load(given.config, Ward)
    if ward.estimator is None:
        raise ConfigError(f"{given.config}: no [estimator] table, so no store; give --store FILE, or another ward file")
    return Backups.of(given.store or ward.estimator.store, ward.estimator.backups)
