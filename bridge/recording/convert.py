"""Converter of a recording of one device, from any supported file to .npz, .csv, .h5, .parquet or .mcap."""

from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np

from bridge.recording import column_files
from bridge.recording.error import RecordingError
from bridge.recording.export import facts
from bridge.recording.files import new_file
from bridge.recording.formats.registry import check_extra
from bridge.recording.message_kinds import KINDS
from bridge.recording.per_sample import PerSample, write_copies
from bridge.recording.recording import TICK_S, Recording, Told
from bridge.recording.recording_file import Item, WardFile
from bridge.recording.stretches import Stretch
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, DeviceInfo, SampleBatch

ENDINGS = (*column_files.ENDINGS, ".mcap", ".sto")
_BRIDGE, _WARD = "converted", "converted"
_BATCH = 256


def check_ending(out: Path) -> None:
    """Check, before any input is read, that an output file can be written.

    Raises RecordingError if its ending is unknown, or its optional package or its folder is missing.
    """
    check_extra(out)
    if out.suffix.lower() not in ENDINGS:
        raise RecordingError(f"{out}: unknown ending {out.suffix!r}: use {', '.join(ENDINGS)}")
    if not out.parent.is_dir():
        raise RecordingError(f"{out}: the folder {out.parent} does not exist; make it: mkdir -p {out.parent}")


def convert(recording: Recording, out: Path, device: str, begin_ns: int, *, per_sample: bool = False) -> None:
    """Write a recording of one device to a new file, in the format of its ending: .npz, .csv, .h5, .parquet or .mcap.

    device: id to write. begin_ns: host time of the first sample, ns since the Unix epoch. per_sample: in a .mcap, write
    each sample also as one ROS 2 message.
    Raises RecordingError if the file exists or cannot be written, and Refusal for an invalid id.
    """
    keys.check_id(device, "--device")
    stretch = _stretch(recording, device, begin_ns)
    with new_file(out) as file:
        if out.suffix.lower() == ".mcap":
            _write_mcap(file, stretch, per_sample=per_sample)
        else:
            column_files.write(file, out.suffix.lower(), stretch.columns, facts(stretch))


def _stretch(recording: Recording, device: str, begin_ns: int) -> Stretch:
    n = len(recording)
    told = recording.told or Told(recording.ticks, TICK_S, recording.sequence, np.zeros(n, np.uint32))
    accel, warm = recording.accel, recording.temperature_c
    boot = recording.boot or 1
    return Stretch(
        device=device,
        bridge=_BRIDGE,
        boot=boot,
        number=1,
        info=DeviceInfo(
            device=device,
            bridge=_BRIDGE,
            boot=boot,
            boot_cause=BootCause.UNKNOWN,
            model=(recording.model or recording.name)[:32],
            firmware="recording",
            driver="",
            port="",
            rate_hz=recording.rate_hz,
            measured_rate_hz=recording.rate_hz,
            gyro_range=recording.gyro_range,
            has_accel=accel is not None,
            has_temperature=warm is not None,
            time_ns=begin_ns,
            samples=n,
        ),
        tick_period_s=told.tick_period_s,
        sequence=told.sequence,
        ticks=told.ticks,
        time_ns=begin_ns + np.rint(recording.time_s * 1e9).astype(np.int64),
        gyro=recording.gyro.astype(np.float32),
        accel=None if accel is None else accel.astype(np.float32),
        temperature_c=None if warm is None else warm.astype(np.float32),
        flags=told.flags,
        computed={},
    )


def _write_mcap(file: BinaryIO, of: Stretch, *, per_sample: bool) -> None:
    out, copies = WardFile(file, _WARD), PerSample(_WARD)

    def put(what: str, at_ns: int, payload: bytes) -> None:
        key = keys.build(_WARD, what, bridge=of.bridge, device=of.device)
        out.put(Item(key, KINDS[what], at_ns, payload), at_ns)

    if of.info is not None:
        put("info", int(of.time_ns[0]), codec.encode_info(of.info))
    holes = np.flatnonzero(np.diff(of.sequence) != 1) + 1
    for start, end in pairwise(np.unique(np.concatenate([np.arange(0, len(of), _BATCH), holes, [len(of)]])).tolist()):
        part = slice(start, end)
        at_ns = int(of.time_ns[start])
        batch = SampleBatch(
            device=of.device,
            boot=of.boot,
            sequence=int(of.sequence[start]),
            receive_time_ns=at_ns,
            start_time_ns=at_ns,
            tick_period_s=of.tick_period_s,
            clock_rate=1.0,
            ticks=of.ticks[part],
            gyro=of.gyro[part],
            accel=None if of.accel is None else of.accel[part],
            temperature_c=None if of.temperature_c is None else of.temperature_c[part],
            flags=of.flags[part],
        )
        put("raw", at_ns, codec.encode_samples(batch))
        if per_sample:
            write_copies(out.writer, copies.take(batch, at_ns * 1e-9))
    out.writer.finish()
