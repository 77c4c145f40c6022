"""The verb `truerate correct`: reads a recording; writes corrected rates, bias, standard deviations and quality."""

import argparse
import json
from pathlib import Path

from bridge.cli.parser import Verbs, add_verb
from bridge.config.schema import ConfigError
from bridge.terminal.console import plain_console
from bridge.terminal.progress import Bar
from estimator.cli import picture_file
from estimator.cli.recording_options import HOLDS, add_choice, check_range, gyro_range, recorded
from estimator.noise.device_model import GENERIC, load_model

HELP = f"""{HOLDS}
corrected:
  a row for each sample: rate, its standard deviation, bias (the reading at zero rate), its standard deviation, quality.
  Orientation: the quaternion turns sensor axes to earth axes (z up), scalar first; standard deviations of tilt and heading.
  A bias' deviation is of its mean over minutes, a rate's has in it what the bias flickers by about that.
  .npz   t_s (n), rate_rad_s, rate_std_rad_s, bias_rad_s, bias_std_rad_s (n, 3), quality (n), a number whose name is in
         quality_names, matrix (3, 3), rate_hz; quat_wxyz (n, 4), tilt_std, heading_std (n) rad;
         and as recorded accel_m_s2 (n, 3), temperature_c (n).
  .csv   the same, a column an axis: t_s, rate_x_rad_s …, rate_std_x_rad_s …, bias_x_rad_s …; quality by its name.
quality:
  NONE, PRIOR          the bias is not known, or in doubt; no scale is known, or that of another boot
  BIAS_ONLY            the bias is known, the scale is not of this boot
  GOOD, DEGRADED       calibrated; DEGRADED while the bias is in doubt or older than it should be
ways:
  --realtime  (default) each row says what was known when its sample came, to the bit as a ward would have published it.
  --smooth    each row says what is known in the end: later rests improve the bias before them, and a calibration within
              the recording is used for all of it.
calibrations:
  Of a ward's recording (.mcap) the calibration that this very boot had when it began, if it had one, is used, and said. Else
  the first three turns within IN are used from there on. --calibration FILE is one made before, in the same boot of the
  device (it has not been switched off since). Of one made before the scale is used at once, the bias is doubted until a
  rest confirms it.
  A ward lets a device warm up for a second after it was switched on. An .npz or .csv does not tell when that was: where that
  second would cost a turn, the device is taken to have been on before, and it is said.
  After a reboot, or of another day, say --other-boot too: its scale is a prior, and its bias is forgotten. Where both files
  tell whose they are, as what a ward recorded does, that is done by itself, and another device's calibration refused.
examples:
  truerate correct day.npz corrected.npz
  truerate calibrate session.npz --json > chest.json
  truerate correct day.npz corrected.csv --calibration chest.json --picture day.png
  truerate correct day.npz corrected.npz --calibration chest.json --other-boot --smooth"""


def add_verbs(verbs: "Verbs[argparse.ArgumentParser]") -> None:
    """Add `correct IN OUT`."""
    verb = add_verb(
        verbs,
        "correct",
        _correct,
        "correct a recording (.npz, .mcap, .csv and other text) as a ward would: rates, bias, deviations, quality",
    )
    verb.epilog, verb.formatter_class = HELP, argparse.RawDescriptionHelpFormatter
    verb.add_argument("file", type=Path, metavar="IN", help="a recording: .npz, .mcap, or text of any tool; see below")
    verb.add_argument(
        "out",
        type=Path,
        metavar="OUT",
        help="where to write, .npz or .csv; one that this wrote before is replaced, no other file",
    )
    way = verb.add_mutually_exclusive_group()
    way.add_argument("--realtime", action="store_true", help="what was known when each sample came (default)")
    way.add_argument("--smooth", action="store_true", help="what is known of each sample in the end")
    verb.add_argument(
        "--calibration", type=Path, metavar="FILE", help="made before, by `truerate calibrate RECORDING --json > FILE`"
    )
    verb.add_argument("--other-boot", action="store_true", help="the device was switched off since that calibration")
    verb.add_argument(
        "--model",
        default=GENERIC,
        metavar="NAME",
        help="kind of device, of configs/devices or a file (default: %(default)s)",
    )
    verb.add_argument(
        "--warmed-up",
        action="store_true",
        help="the device had been on, and worn, for a quarter of an hour; else its bias may warm up, where no temperature tells",
    )
    verb.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw rates, bias, quality and temperature (.png, .svg, .pdf)"
    )
    verb.add_argument("--json", action="store_true", help="one JSON object in place of words")
    add_choice(verb)
    verb.add_argument(
        "--range-dps", type=float, default=0.0, metavar="DPS", help="full-scale range in °/s, to notice clipping"
    )


def _correct(given: argparse.Namespace) -> None:
    from estimator.config.device_settings import knobs_of  # noqa: PLC0415
    from estimator.offline import calibration_file, corrected_file  # noqa: PLC0415
    from estimator.offline.recordings import correct  # noqa: PLC0415
    from estimator.reports import correction  # noqa: PLC0415

    if given.other_boot and given.calibration is None:
        raise ConfigError("--other-boot says of which boot a calibration is: it needs --calibration FILE")
    check_range(given)
    model = load_model(given.model)
    corrected_file.check(given.out, given.file)
    if given.picture is not None:
        picture_file.check("--picture", given.picture)
        if given.out.absolute() in given.picture.absolute().parents:
            raise ConfigError(
                f"--picture {given.picture}: {given.out} is to be a file of corrected rates, not a folder"
            )
    calibration = calibration_file.load(given.calibration) if given.calibration else None
    recording = recorded(given)
    with Bar() as bar:
        corrected = correct(
            recording,
            calibration,
            knobs_of(model),
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
        return
    console = plain_console()
    for words in correction.said(corrected):
        console.print(words, style="dim", highlight=False, soft_wrap=True)
    for words in correction.as_words(corrected, recording, given.out):
        console.print(words, highlight=False, soft_wrap=True)
    if given.picture is not None:
        console.print(f"drawn in {given.picture}", highlight=False, soft_wrap=True)
