"""Verb `truerate calibrate`: calibrates from a recording, or guides a person with a live device."""

import argparse
import json
from math import isfinite, radians
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from bridge.cli.parser import Verbs, add_verb
from bridge.cli.reading_options import add_reading
from bridge.config.schema import ConfigError
from bridge.reasons.catalogue import english
from bridge.terminal.console import plain_console
from bridge.wire.messages import Calibration, Verdict
from estimator.cli.calibrate_live import add_live, live
from estimator.cli.recording_options import HOLDS, check_range, gyro_range, recorded
from estimator.noise.device_model import load_model

if TYPE_CHECKING:
    from estimator.calibration.result import Result

METHODS = f"""{HOLDS}

A ward's recording (.mcap) may hold a calibration that the ward made of this boot. truerate shows that calibration,
unless you give --method or --model.

result: corrected rate = k x (reading - bias), or matrix x (reading - bias). The bias is the reading at zero rate.
  An accelerometer is calibrated too, as scale x (reading - bias), if the device rests in six poses or more.
methods:
  closure      (default) three full turns by hand on a table edge, one about each axis, with rests of 3 s. Estimates bias
               and scale by maximum likelihood from all rests and turns, and from gravity if there is an accelerometer.
  turn360      the same session by Algorithm 1 of Wang et al. 2024. The scale is wrong if the hand wobbles.
  transitions  movements between poses, each pose held still for 3 s. Estimates bias, scale and misalignment from gravity
               before and after each movement; needs an accelerometer. Lay the device on each of its six sides, and turn it
               by a quarter or a half about every axis in between. Full turns improve the scale. If the poses do not show
               the misalignment, the result has bias and scale only.
  accel_aided  at least nine poses; calibrates the accelerometer first (Tedaldi et al. 2014).
  turntable    a machine turns the device at known rates about each axis, both ways, 1.5 s or more each. Estimates bias,
               scale, and misalignment against the fixture. Needs --rates-dps.
  servomotor   a machine turns the device at one known rate, both ways, in three or more mountings with different axes,
               after a rest of 1.5 s before each spin. Estimates bias and scale. Needs --rates-dps.
examples:
  truerate calibrate --live chest --config configs/ward.toml   guides a person step by step
  truerate calibrate session.npz
  truerate calibrate session.npz --model mpu-6050              refuses turns that contradict the data sheet
  truerate calibrate poses.csv --method transitions --json
  truerate calibrate table.npz --method turntable --rates-dps 30,60,90"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `calibrate FILE`, with its option --live, to the command line."""
    verb = add_verb(
        verbs,
        "calibrate",
        _calibrate,
        "calibrate a gyroscope from a recording of rests and turns (.npz, .mcap, .csv and other text), or live",
        METHODS,
    )
    verb.add_argument(
        "file", type=Path, nargs="?", help="a recording: .npz, .mcap, or a text file of any tool; see below"
    )
    add_live(verb)
    verb.add_argument("--method", metavar="NAME", help="calibration method (default: closure); see below")
    verb.add_argument(
        "--rates-dps",
        type=_rates,
        default=(),
        metavar="DPS,…",
        help="the machine's known rates in °/s, for example 30,60,90",
    )
    verb.add_argument(
        "--model",
        metavar="NAME",
        help="device model, a name in configs/devices or a .toml file: range, noise and tolerance of the scale factor;"
        " turns outside the tolerance are refused",
    )
    verb.add_argument(
        "--json", action="store_true", help="print one JSON object: matrix, bias_rad_s, covariance, verdict, turns …"
    )
    add_reading(verb)
    verb.add_argument(
        "--range-dps", type=float, default=0.0, metavar="DPS", help="full-scale range in °/s, to detect clipping"
    )


def _rates(text: str) -> tuple[float, ...]:
    try:
        rates = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"invalid rates {text!r}: give numbers in °/s, for example 30,60,90") from None
    if not all(0.1 <= rate <= 5000 for rate in rates):
        raise argparse.ArgumentTypeError(
            f"invalid rates {text!r}: give each rate once, without a sign, from 0.1 to 5000 °/s"
        )
    return rates


def _calibrate(given: argparse.Namespace) -> int:
    if given.live:
        return live(given)
    if given.file is None:
        raise ConfigError("no recording is given: give a file, or --live DEVICE for a device of a running ward")
    from estimator.calibration.method_names import BY_HAND, DEFAULT  # noqa: PLC0415
    from estimator.calibration.methods import BY_RATES  # noqa: PLC0415
    from estimator.config.device_settings import knobs_of  # noqa: PLC0415
    from estimator.offline.calibration_file import of_result  # noqa: PLC0415
    from estimator.offline.recordings import calibrate  # noqa: PLC0415
    from estimator.reports.calibration import accelerometer_as_words, as_json, as_notes, first  # noqa: PLC0415

    method = given.method or DEFAULT
    if method not in (names := (*BY_HAND, *BY_RATES)):
        raise ConfigError(f"unknown method {method!r}: use one of {', '.join(names)}")
    if bool(given.rates_dps) != (method in BY_RATES):
        raise ConfigError(
            f"method {method} {'needs' if method in BY_RATES else 'does not use'} --rates-dps, the machine's known rates"
        )
    check_range(given)
    knobs = knobs_of(load_model(given.model)) if given.model else None
    recording = recorded(given)
    if given.method is None and given.model is None and recording.made:
        return _show_made(recording.made[-1], as_json=given.json)
    rates = tuple(map(radians, given.rates_dps))
    result, passed_over = calibrate(recording, method, gyro_range(given, recording), rates, knobs)
    if given.json:
        print(
            json.dumps(
                as_json(
                    result, of_result(result, recording, gyro_range(given, recording)), passed_over, recording.notes
                )
            )
        )
    else:
        console = Console()
        for words in first(passed_over):
            console.print(f"not used: {words}", style="dim", highlight=False, soft_wrap=True)
        if isfinite(result.covariance.sum()):
            _show_parameters(console, result)
        console.print(
            f"{result.verdict.name.lower()} ({result.method}): {english(*result.reason)}",
            highlight=False,
            soft_wrap=True,
        )
        for line in (*accelerometer_as_words(result.accelerometer), *as_notes(recording.notes)):
            console.print(line, highlight=False, markup=False, soft_wrap=True)
    return 0 if result.verdict is Verdict.ACCEPTED else 1


def _show_made(calibration: Calibration, *, as_json: bool) -> int:
    """Show a calibration that was made live, in the recorded boot."""
    from estimator.reports.calibration import accelerometer_as_words, recorded_as_json  # noqa: PLC0415

    if as_json:
        print(json.dumps(recorded_as_json(calibration)))
        return 0
    console = plain_console()
    _show_parameters(console, calibration)
    for line in (
        f"accepted ({calibration.method}): {english(*calibration.reason)}",
        *accelerometer_as_words(calibration.accelerometer),
    ):
        console.print(line, highlight=False, soft_wrap=True)
    console.print(
        f"The ward made this calibration of this boot ({calibration.id}). To calibrate from the samples instead, give "
        "--method or --model NAME.",
        highlight=False,
        soft_wrap=True,
    )
    return 0


def _show_parameters(console: Console, of: "Result | Calibration") -> None:
    from estimator.calibration.result import PARAMETERS  # noqa: PLC0415
    from estimator.reports.calibration import as_matrix, as_table  # noqa: PLC0415

    console.print(as_table(of))
    if len(of.parameters) > len(PARAMETERS):
        console.print(as_matrix(of))
