"""Reader of recordings: of a ward (.mcap), or of any format in `bridge.recording.formats.registry`.

To support another format, add a module with a function `read` to `bridge.recording.formats` and a line to the registry.
"""

import logging
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from bridge.recording import stretches
from bridge.recording.error import MAX_BYTES, RecordingError, check_file
from bridge.recording.formats.registry import WARD, format_of
from bridge.recording.formats.streams import choose, choose_boot
from bridge.recording.reading import AS_SAID, Reading
from bridge.recording.recording import TICK_S, Recording, Told
from bridge.recording.stretches import Stretch
from bridge.recording.table import believed, recording_of
from bridge.recording.text.reader import join_accel
from bridge.wire.messages import Calibration

__all__ = ["MAX_BYTES", "TICK_S", "Reading", "Recording", "RecordingError", "Told", "load"]

_log = logging.getLogger(__name__)


def load(
    path: Path | str,
    rate_hz: float | None = None,
    *,
    device: str | None = None,
    boot: int | None = None,
    reading: Reading = AS_SAID,
) -> Recording:
    """Read the recording of one device from a file, or from a folder if the format is a folder; SI units.

    rate_hz: output data rate, Hz; it replaces the file's times. device: name of the device, topic, stream or sensor in
    a file with several. boot: number of the boot, from 1. These three replace the same options in `reading`.
    reading: further options, for facts that the file does not state or states wrongly.
    Raises RecordingError if the file is unreadable, its data is implausible, or a needed option is missing.
    """
    path = Path(path)
    reading = replace(
        reading,
        rate_hz=reading.rate_hz if rate_hz is None else rate_hz,
        device=device or reading.device,
        boot=reading.boot if boot is None else boot,
    )
    if not path.is_dir():
        check_file(path)
    if path.suffix == ".part":
        raise RecordingError(
            f"{path}: the recording was not finished; complete it first: truerate recording recover {path}"
        )
    format_ = format_of(path)
    if format_.whole and (size := path.stat().st_size) > MAX_BYTES:
        raise RecordingError(f"{path}: the file has {size} bytes; at most {MAX_BYTES} are allowed: split the file")
    if reading.device is not None and not format_.streams:
        raise RecordingError(f"{path}: the file holds one device: leave --device out")
    if format_ is WARD:
        return _of_stretch(path, *_chosen(path, reading.device, reading.boot))
    # Overflowing values become infinite, and are later dropped or refused with their samples.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        table = format_.read(path, reading)
        join_accel(path, table, reading)
        return recording_of(path, table, reading)


def _chosen(path: Path, device: str | None, boot: int | None) -> tuple[Stretch, list[Calibration]]:
    """Return one boot of one device from a ward's recording, and its calibrations. Raises RecordingError."""
    recorded = stretches.read([path], corrected=False)
    for words in recorded.trouble:
        _log.warning("%s", words)
    found = recorded.stretches
    if not found:
        raise RecordingError(f"{path}: the recording has no samples; `truerate recording info` shows what it holds")
    boots = choose(path, found, device, "devices")
    at = choose_boot(path, [len(one) for one in boots], boot, boots[0].device)
    chosen = boots[at]
    return chosen, recorded.calibrations_of(chosen)


def _of_stretch(path: Path, of: Stretch, made: list[Calibration]) -> Recording:
    gyro, notes = of.gyro.astype(np.float64), list[str]()
    accel = believed(path, gyro, None if of.accel is None else of.accel.astype(np.float64), of.rate_hz, notes)
    return Recording(
        time_s=of.time_s,
        gyro=gyro,
        accel=accel,
        temperature_c=None if of.temperature_c is None else of.temperature_c.astype(np.float64),
        rate_hz=of.rate_hz,
        name=f"{path.stem}_{of.device}",
        gyro_range=of.info.gyro_range if of.info else 0.0,
        made=tuple(made),
        begin_ns=int(of.time_ns[0]),
        told=Told(of.ticks, of.tick_period_s, of.sequence, of.flags),
        device=of.device,
        boot=of.boot,
        model=of.info.model if of.info else "",
        notes=tuple(notes),
    )
