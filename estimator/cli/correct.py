"""Verb `truerate correct`: reads a recording, and writes corrected rates, bias, standard deviations and quality."""

import argparse
import json
from pathlib import Path

from bridge.cli.parser import Verbs, add_verb
from bridge.cli.reading_options import add_reading
from bridge.config.schema import ConfigError
from bridge.terminal.console import plain_console
from bridge.terminal.progress import Bar
from estimator.cli import picture_file
from estimator.cli.recording_options import HOLDS, check_range, gyro_range, recorded
from estimator.noise.device_model import load_model, model_stated

HELP = f"""{HOLDS}
corrected:
  a row for each sample: rate, its standard deviation, bias (the reading at zero rate), its standard deviation, quality.
  Orientation: the quaternion turns sensor axes to earth axes (z up), scalar first; standard deviations of tilt and heading.
  The standard deviation of the bias is that of its mean over minutes. That of the rate also contains the flicker of the bias.
  .npz   t_s (n), rate_rad_s, rate_std_rad_s, bias_rad_s, bias_std_rad_s (n, 3), quality (n) as an index of quality_names,
         matrix (3, 3), rate_hz; quat_wxyz (n, 4), tilt_std, heading_std (n) rad;
         and as recorded accel_m_s2 (n, 3), temperature_c (n).
  .csv   the same with one column per axis: t_s, rate_x_rad_s …, rate_std_x_rad_s …, bias_x_rad_s …; quality by name.
  .h5 .parquet  HDF5 with the arrays of .npz, Parquet with the columns of .csv.
quality:
  NONE                 bias unknown or in doubt, scale unknown
  PRIOR                bias unknown or in doubt, scale from another boot
  BIAS_ONLY            bias known, scale not from this boot
  GOOD                 calibrated
  DEGRADED             calibrated, but the bias is in doubt or too old
ways:
  --realtime  (default) each row uses only data up to its sample, and equals bit for bit what a ward would have published.
  --smooth    each row uses the whole recording: later rests improve the earlier bias, and a calibration found in the
              recording corrects all rows.
calibrations:
  A ward's recording (.mcap) may hold the calibration that was in force at its start. truerate uses that calibration and
  reports it. Otherwise truerate uses the first three turns in IN, from their end onwards.
  --calibration FILE gives an earlier calibration of the same boot: the device was not switched off in between. The
  scale is used at once, and the bias is in doubt until a rest confirms it.
  --other-boot declares that the device was switched off since that calibration. The scale is then a prior, and the bias
  is not used. If both files name device and boot, truerate decides this itself, and refuses another device's calibration.
  A ward ignores the first second after power-up. An .npz or .csv does not tell the time of power-up. If that second would
  cost a turn, truerate assumes an earlier power-up and reports it.
examples:
  truerate correct day.npz corrected.npz
  truerate calibrate session.npz --json > chest.json
  truerate correct day.npz corrected.csv --calibration chest.json --picture day.png
  truerate correct day.npz corrected.npz --calibration chest.json --other-boot --smooth
  truerate correct day.npz corrected.npz --learn-matrix"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add the verb `correct IN OUT` to the command line."""
    verb = add_verb(
        verbs,
        "correct",
        _correct,
        "correct a recording (.npz, .mcap, .csv and other text) as a ward would: rates, bias, standard deviations, quality",
        HELP,
    )
    verb.add_argument("file", type=Path, metavar="IN", help="a recording, a file or a folder; see below")
    verb.add_argument(
        "out",
        type=Path,
        metavar="OUT",
        help="output file, .npz, .csv, .h5 or .parquet; an existing file is overwritten only if `truerate correct` wrote it",
    )
    way = verb.add_mutually_exclusive_group()
    way.add_argument("--realtime", action="store_true", help="use only data up to each sample (default)")
    way.add_argument("--smooth", action="store_true", help="use the whole recording for every sample")
    verb.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="a calibration from `truerate calibrate RECORDING --json > FILE`",
    )
    verb.add_argument("--other-boot", action="store_true", help="the device was switched off after that calibration")
    verb.add_argument(
        "--model",
        metavar="NAME",
        help="device model, a name in configs/devices or a .toml file (default: as the recorded device states, else generic)",
    )
    verb.add_argument(
        "--warmed-up",
        action="store_true",
        help="the device was on and worn for 15 minutes before: assume no warm-up drift (matters only without a thermometer)",
    )
    verb.add_argument(
        "--learn-matrix",
        action="store_true",
        help="estimate scale and misalignment from gravity in motion; use them once they are more certain than the calibration",
    )
    verb.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw rates, bias, quality and temperature (.png, .svg, .pdf)"
    )
    verb.add_argument("--json", action="store_true", help="print one JSON object")
    add_reading(verb)
    verb.add_argument(
        "--range-dps", type=float, default=0.0, metavar="DPS", help="full-scale range in °/s, to detect clipping"
    )


def _correct(given: argparse.Namespace) -> int:
    from estimator.config.device_settings import knobs_of, knobs_of_stated, learning  # noqa: PLC0415
    from estimator.offline import calibration_file, corrected_file  # noqa: PLC0415
    from estimator.offline.recordings import correct  # noqa: PLC0415
    from estimator.reports import correction  # noqa: PLC0415

    if given.other_boot and given.calibration is None:
        raise ConfigError(
            "--other-boot is given without a calibration: add --calibration FILE, or leave --other-boot out"
        )
    check_range(given)
    told = knobs_of(load_model(given.model)) if given.model else None
    corrected_file.check(given.out, given.file)
    if given.picture is not None:
        picture_file.check("--picture", given.picture)
        if given.out.absolute() in given.picture.absolute().parents:
            raise ConfigError(
                f"--picture {given.picture}: {given.out} is the output file, not a folder; give the picture another path"
            )
    calibration = calibration_file.load(given.calibration) if given.calibration else None
    recording = recorded(given)
    knobs = told or knobs_of_stated(recording.model)
    with Bar() as bar:
        corrected = correct(
            recording,
            calibration,
            learning(knobs) if given.learn_matrix else knobs,
            smooth=given.smooth,
            warmed_up=given.warmed_up,
            other_boot=given.other_boot,
            gyro_range=gyro_range(given, recording),
            progress=bar.on("correcting"),
        )
        corrected_file.save(given.out, corrected, recording, bar.on("writing"))
    if given.picture is not None:
        from estimator import figures  # noqa: PLC0415

        given.picture.parent.mkdir(parents=True, exist_ok=True)
        figures.corrected(recording, corrected, given.picture)
    if given.json:
        print(json.dumps(correction.as_json(corrected, recording, given.out)))
        return 0 if correction.bias_known(corrected) else 1
    console = plain_console()
    if told is None and (stated := model_stated(recording.model)):
        console.print(f"noise model {stated}, from the device", style="dim", highlight=False, soft_wrap=True)
    for words in correction.said(corrected):
        console.print(words, style="dim", highlight=False, soft_wrap=True)
    for words in correction.as_words(corrected, recording, given.out):
        console.print(words, highlight=False, soft_wrap=True)
    if given.picture is not None:
        console.print(f"picture: {given.picture}", highlight=False, soft_wrap=True)
    return 0 if correction.bias_known(corrected) else 1
