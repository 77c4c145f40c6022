"""Writer of .sto files for OpenSim's OpenSense: orientations and rates, a column per body segment, at common times."""

import logging
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.recording import stretches
from bridge.recording.error import RecordingError, check_file
from bridge.recording.files import check_new, new_file
from bridge.recording.stretches import Stretch
from bridge.terminal.plurals import count
from bridge.wire import keys

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
ENDING = ".sto"
#: added to the name of the file for the file of rates
RATES = "_angularVelocity"
#: what OpenSense expects behind the name of a body
IMU = "_imu"
#: arrays of an .npz, as `truerate correct` and `recording export` write them
_WANTED = ("quat_wxyz", "host_time_ns", "t_s", "rate_rad_s", "device")
#: samples further apart than this many usual steps have a gap between them
GAP_STEPS = 3.0


class Track(NamedTuple):
    """Orientations of one device at its n sample times.

    body: segment of the OpenSim model, from the recorded placement; else the device id.
    time_ns (n,): host time, ns since the Unix epoch, rising. quat_wxyz (n, 4): sensor to earth, z up, scalar first.
    rate (n, 3): rad/s, sensor frame; None if unknown.
    """

    device: str
    body: str
    time_ns: NDArray[np.int64]
    quat_wxyz: Floats
    rate: Floats | None


def convert(
    files: Sequence[Path],
    out: Path,
    devices: Sequence[str],
    boot: int | None,
    segments: Mapping[str, str],
    skip_s: float = 0.0,
) -> list[str]:
    """Write the orientations and rates of devices as OpenSim .sto files, at the sample times of the first device.

    out: file of orientations. The file of rates is written beside it, if every device has rates. devices: ids to write,
    empty for all. boot: number of the boot in a ward's recording, from 1; None if only one is recorded.
    segments: body of the OpenSim model by device id. The default is the body of the recorded placement, else the device
    id. skip_s: seconds to leave out at the beginning.
    Returns the result as lines for the user. Raises RecordingError if a device has no orientation, the choice is
    ambiguous, or a file exists already.
    """
    tracks = [track for track in _tracks(files, boot) if not devices or track.device in devices]
    names = {track.device: segments.get(track.device, track.body) for track in tracks}
    for device in (*devices, *segments):
        if device not in names:
            there = ", ".join(names) or "none"
            raise RecordingError(f"{files[0]}: no orientation of device {device!r}; devices with orientation: {there}")
    for name in names.values():
        if list(names.values()).count(name) > 1:
            raise RecordingError(f"two devices are on {name!r}: name another body with --segment DEVICE=BODY")
    times, left_out = _common_times(tracks, skip_s)
    paths = [out]
    with_rates = [track for track in tracks if track.rate is not None]
    if len(with_rates) == len(tracks):
        paths.append(out.with_name(f"{out.stem}{RATES}{ENDING}"))
    check_new(paths)
    seconds = (times - times[0]) * 1e-9
    rate_hz = 1 / float(np.median(np.diff(seconds)))
    for path, kind, values in zip(paths, ("Quaternion", "Vec3"), (_quaternions, _rates), strict=False):
        _write(path, kind, rate_hz, seconds, {f"{names[t.device]}{IMU}": values(t, times) for t in tracks})
    lines = [f"{' and '.join(map(str, paths))}: {len(times):,} times of {', '.join(names.values())}"]
    return lines + ([f"note: {left_out:,} times are left out: a device has a gap there"] if left_out else [])


def _tracks(files: Sequence[Path], boot: int | None) -> list[Track]:
    recorded = [file for file in files if file.suffix.lower() == ".mcap"]
    tracks = _of_ward(recorded, boot) if recorded else []
    tracks += [_of_npz(file) for file in files if file not in recorded]
    for one, other in pairwise(sorted(track.device for track in tracks)):
        if one == other:
            raise RecordingError(f"device {one!r} is in two of the files: leave out one of these files")
    return tracks


def _of_ward(files: list[Path], boot: int | None) -> list[Track]:
    recorded, found = stretches.read(files), list[Track]()
    for words in recorded.trouble:
        _log.warning("%s", words)
    for device, boots in recorded.stretches.items():
        oriented = [one for one in boots if "quat_wxyz" in one.computed and boot in (None, one.number)]
        if len(oriented) > 1:
            said = ", ".join(str(one.number) for one in oriented)
            raise RecordingError(f"{files[0]}: {device} has {len(oriented)} boots; choose one with --boot: {said}")
        found += [_track(device, _body(one), one.time_ns, one.computed) for one in oriented]
    if not found:
        raise RecordingError(
            f"{files[0]}: no orientation was recorded; `truerate record` records it while a ward's estimator runs,"
            " and `truerate correct IN OUT.npz` computes it for one device"
        )
    return found


def _body(of: Stretch) -> str:
    """Body of the last placement that has one; without a placement the device's id."""
    return next((one.body for one in reversed(of.placements) if one.body), of.device)


def _of_npz(path: Path) -> Track:
    check_file(path)
    if path.suffix.lower() != ".npz":
        raise RecordingError(
            f"{path}: this file cannot become an OpenSim file: give a .mcap or .npz recording with orientation"
        )
    try:
        with np.load(path, allow_pickle=False) as file:
            found = {name: file[name] for name in _WANTED if name in file.files}
    except Exception:  # noqa: BLE001 - a damaged archive fails in many ways
        raise RecordingError(f"{path}: not a readable .npz: damaged, or of another format") from None
    time_ns = found["host_time_ns"] if "host_time_ns" in found else np.rint(found.get("t_s", np.zeros(0)) * 1e9)
    if "quat_wxyz" not in found or not len(time_ns):
        raise RecordingError(
            f"{path}: no orientation: `truerate correct {path} OUT.npz` computes it; then convert OUT.npz"
        )
    for name, of in (("quat_wxyz", 4), ("rate_rad_s", 3)):
        if name in found and (found[name].shape != (len(time_ns), of) or found[name].dtype.kind != "f"):
            raise RecordingError(
                f"{path}: {name!r} has shape {found[name].shape}; numbers of shape ({len(time_ns)}, {of}) are needed"
            )
    device = str(found.get("device", ""))
    if not keys.ID.match(device):
        device = re.sub("[^a-z0-9]+", "_", path.stem.lower()).strip("_")[:32] or "device"
    return _track(device, device, time_ns.astype(np.int64), found)


def _track(device: str, body: str, time_ns: NDArray[np.int64], columns: Mapping[str, NDArray[Any]]) -> Track:
    """Keep the samples with an orientation whose time is later than all before."""
    quat_wxyz, rate = columns["quat_wxyz"], columns.get("rate_rad_s")
    later = time_ns > np.concatenate([[-1], np.maximum.accumulate(time_ns)[:-1]])
    rows = later & np.isfinite(quat_wxyz).all(axis=1)
    if rate is not None:
        rows &= np.isfinite(rate).all(axis=1)
        rate = rate[rows].astype(np.float64)
    if rows.sum() < 2:
        raise RecordingError(
            f"{device}: {count(int(rows.sum()), 'sample')} with orientation; at least 2 such samples are needed"
        )
    return Track(device, body, time_ns[rows], quat_wxyz[rows].astype(np.float64), rate)


def _common_times(tracks: list[Track], skip_s: float) -> tuple[NDArray[np.int64], int]:
    """Sample times of the first device at which every device has samples, and how many are left out between them."""
    begin = max(int(t.time_ns[0]) for t in tracks) + round(skip_s * 1e9)
    end = min(int(t.time_ns[-1]) for t in tracks)
    times = tracks[0].time_ns
    times = times[(times >= begin) & (times <= end)]
    there = np.ones(len(times), np.bool_)
    for track in tracks:
        time_ns = track.time_ns
        step = np.diff(time_ns)
        at = np.clip(np.searchsorted(time_ns, times, side="right") - 1, 0, len(step) - 1)
        there &= (step[at] <= GAP_STEPS * np.median(step)) | (time_ns[at] == times)
    if there.sum() < 2:
        spans = ", ".join(f"{t.device} {t.time_ns[0] / 1e9:.3f} to {t.time_ns[-1] / 1e9:.3f} s" for t in tracks)
        raise RecordingError(
            f"the devices have no time in common after --skip {skip_s:g}: {spans}; give recordings of one session, with host"
            " times, as written by `truerate record` or `truerate recording export --npz`"
        )
    return times[there], int((~there).sum())


def _quaternions(track: Track, times: NDArray[np.int64]) -> Floats:
    """(n, 4) scalar first, along the shortest rotation between samples."""
    since = track.time_ns[0]
    turns = Slerp((track.time_ns - since) * 1e-9, Rotation.from_quat(track.quat_wxyz, scalar_first=True))
    return np.asarray(turns((times - since) * 1e-9).as_quat(scalar_first=True))


def _rates(track: Track, times: NDArray[np.int64]) -> Floats:
    assert track.rate is not None
    since = track.time_ns[0]
    at, known = (times - since) * 1e-9, (track.time_ns - since) * 1e-9
    return np.column_stack([np.interp(at, known, axis) for axis in track.rate.T])


def _write(path: Path, kind: str, rate_hz: float, seconds: Floats, columns: Mapping[str, Floats]) -> None:
    head = f"DataRate={rate_hz:.6f}\nDataType={kind}\nversion=3\nOpenSimVersion=4.5\nendheader\n"
    texts = [[",".join(f"{value:.10g}" for value in row) for row in values.tolist()] for values in columns.values()]
    with new_file(path) as file:
        file.write((head + "\t".join(["time", *columns]) + "\n").encode())
        for at, *cells in zip(seconds.tolist(), *texts, strict=True):
            file.write(("\t".join([f"{at:.9f}", *cells]) + "\n").encode())
