"""Verb `truerate allan`: computes the noise of a device from a recording at rest, by the Allan deviation."""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.cli.parser import Verbs, add_verb
from bridge.cli.reading_options import add_reading
from bridge.config.schema import ConfigError
from bridge.terminal.console import plain_console
from estimator.cli import picture_file
from estimator.cli.recording_options import HOLDS, recorded
from estimator.noise.device_model import load_model

if TYPE_CHECKING:
    from estimator.offline.noise_identification import AtRest

ALLAN = f"""Lay the device down where nobody walks, let it warm up, and record. A recording of one minute shows the angle
random walk. A recording of one hour also shows how the bias wanders. truerate uses the longest rest in the file.
The table gives each coefficient with its 95 % interval, or an upper limit where the recording is too short.

{HOLDS}
examples:
  truerate allan night.npz                                  prints a table and draws out/allan.png
  truerate allan night.csv --rate-hz 100 --json             prints one JSON object in SI units
  truerate allan night.npz --write configs/devices/mine.toml --model mpu-6050
                                                            writes a device model; values that the recording
                                                            does not show are those of the mpu-6050"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `allan FILE` to the command line."""
    verb = add_verb(
        verbs, "allan", _allan, "measure a device's noise from a recording at rest (Allan deviation)", ALLAN
    )
    verb.add_argument("file", type=Path, help="a recording: .npz, .mcap, or a text file of any tool; see below")
    add_reading(verb)
    verb.add_argument("--json", action="store_true", help="print one JSON object instead of a table and a picture")
    verb.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw the Allan deviation here (default: out/allan.png)"
    )
    verb.add_argument("--write", type=Path, metavar="FILE", help="write a device model to this new .toml file")
    verb.add_argument(
        "--model",
        default="generic",
        metavar="NAME",
        help="device model for values that a rest cannot show: a name in configs/devices, or a .toml file "
        "(default: %(default)s)",
    )


def _allan(given: argparse.Namespace) -> None:
    from estimator.offline.noise_identification import identify_noise  # noqa: PLC0415
    from estimator.reports.noise import as_json, as_table, sentences  # noqa: PLC0415

    picture = given.picture or (None if given.json else Path("out/allan.png"))
    if picture:
        picture_file.check("--picture", picture)
    load_model(given.model)
    if given.write:
        _check_written(given.write)
    rest = identify_noise(recorded(given))
    if given.json:
        print(json.dumps(as_json(rest)))
    else:
        console = plain_console()
        console.print(as_table(rest))
        for sentence in sentences(rest):
            console.print(sentence, style="dim", highlight=False)
    if picture:
        from estimator import figures  # noqa: PLC0415

        picture.parent.mkdir(parents=True, exist_ok=True)
        figures.allan(rest, f"Allan deviation of {given.file.stem}", picture)
    if given.write:
        _write(given.write, given.file, rest, given.model)
    if not given.json:
        for path in filter(None, (picture, given.write)):
            print(f"written: {path}")


def _check_written(path: Path) -> None:
    """Refuse an unusable output path before the long computation."""
    if path.suffix != ".toml":
        raise ConfigError(f"--write {path}: give a file name that ends in .toml")
    if path.exists():
        raise ConfigError(f"--write {path}: the file exists already; give another name, or remove the file")
    picture_file.check_folder("--write", path)


def _write(path: Path, source: Path, rest: "AtRest", like: str) -> None:
    from estimator.noise.device_model import as_toml  # noqa: PLC0415
    from estimator.offline.noise_identification import measured  # noqa: PLC0415

    kind = load_model(like)
    model, origin = measured(rest, kind)
    head = (
        f"Measured from {source.name}: {rest.duration_s:.0f} s at rest, {rest.rate_hz:.1f} readings a second.\n"
        f"Values that are not marked as measured are those of the model {kind.model}."
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("x", encoding="utf-8") as file:
        file.write(as_toml(replace(model, model=path.stem), origin, head))
