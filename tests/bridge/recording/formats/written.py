"""Writes the simulated session in the formats of other tools: by their own libraries, else from their published layouts."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tests.bridge.recording.text.session import ACCEL_MS2, GYRO_DPS, TIME

IMU = "sensor_msgs/msg/Imu"
T0_NS = 1_700_000_000_000_000_000
RATE = np.radians(GYRO_DPS)


def _messages(store: Any, *, stamped: bool, no_gyro: bool) -> list[tuple[int, Any]]:
    vector, time = store.types["geometry_msgs/msg/Vector3"], store.types["builtin_interfaces/msg/Time"]
    extra = {"seq": 0} if "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    still = store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    unknown, none = np.zeros(9), np.array([-1.0, *[0.0] * 8])
    made = []
    for t, rate, force in zip(TIME, RATE, ACCEL_MS2, strict=True):
        at = T0_NS + round(t * 1e9)
        stamp = time(at // 10**9, at % 10**9) if stamped else time(0, 0)
        header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="imu", **extra)
        made.append(
            (
                at,
                store.types[IMU](
                    header, still, unknown, vector(*rate), none if no_gyro else unknown, vector(*force), unknown
                ),
            )
        )
    return made


def bag1(path: Path, topics: Sequence[str] = ("/imu",), *, stamped: bool = True, no_gyro: bool = False) -> Path:
    """A ROS 1 bag."""
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as bag:
        for topic in topics:
            connection = bag.add_connection(topic, IMU, typestore=store)
            for at, message in _messages(store, stamped=stamped, no_gyro=no_gyro):
                bag.write(connection, at, store.serialize_ros1(message, IMU))
    return path


def bag2(path: Path, plugin: StoragePlugin) -> Path:
    """A ROS 2 bag, a folder."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer2(path, version=9, storage_plugin=plugin) as bag:
        connection = bag.add_connection("/imu", IMU, typestore=store)
        for at, message in _messages(store, stamped=True, no_gyro=False):
            bag.write(connection, at, store.serialize_cdr(message, IMU))
    return path


def xdf(path: Path, streams: Sequence[tuple[str, Sequence[tuple[str, str]], Any]]) -> Path:
    """An XDF file of streams (name, channels as (label, unit), samples (n, c)). Source: github.com/sccn/xdf/wiki."""
    parts = [b"XDF:", _chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")]
    for number, (name, channels, samples) in enumerate(streams, 1):
        said = "".join(f"<channel><label>{label}</label><unit>{unit}</unit></channel>" for label, unit in channels)
        about = (
            f"<info><name>{name}</name><type>MoCap</type><channel_count>{len(channels)}</channel_count><nominal_srate>50"
            f"</nominal_srate><channel_format>double64</channel_format><desc><channels>{said}</channels></desc></info>"
        )
        parts.append(_chunk(2, struct.pack("<I", number) + about.encode()))
        rows = b"".join(
            b"\x08" + struct.pack("<d", 100 + t) + row.tobytes() for t, row in zip(TIME, samples, strict=True)
        )
        parts.append(_chunk(3, struct.pack("<I", number) + b"\x04" + struct.pack("<I", len(TIME)) + rows))
    path.write_bytes(b"".join(parts))
    return path


def _chunk(tag: int, content: bytes) -> bytes:
    return b"\x08" + struct.pack("<QH", len(content) + 2, tag) + content


def ximu3(path: Path) -> Path:
    """A data logger's file: every second message in ASCII, the others binary. Source: x-IMU3 user manual."""
    lines = [b'{"serial_number":"0123-4567"}\r\n', b"T,1000,31.5\r\n"]
    for number, (t, rate, force) in enumerate(zip(TIME, GYRO_DPS, ACCEL_MS2 / 9.80665, strict=True)):
        time_us = 5_000_000 + round(t * 1e6)
        if number % 2:
            lines.append(f"I,{time_us},{','.join(f'{value:.6f}' for value in (*rate, *force))}\r\n".encode())
        else:
            raw = struct.pack("<BQ6f", 0xC9, time_us, *rate, *force)
            lines.append(raw.replace(b"\xdb", b"\xdb\xdd").replace(b"\n", b"\xdb\xdc") + b"\n")
    path.write_bytes(b"".join(lines))
    return path


def euroc(path: Path, names: Sequence[str] = ("imu0",)) -> Path:
    """A EuRoC sequence, a folder."""
    for name in names:
        (path / "mav0" / name).mkdir(parents=True)
        head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        head += "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
        rows = [
            ",".join([str(T0_NS + round(t * 1e9)), *(f"{value:.9f}" for value in (*rate, *force))])
            for t, rate, force in zip(TIME, RATE, ACCEL_MS2, strict=True)
        ]
        (path / "mav0" / name / "data.csv").write_text("\n".join([head, *rows]))
    return path


def bids(folder: Path, points: Sequence[str] = ("wrist",)) -> Path:
    """A BIDS-Motion recording in °/s and g, whose rate is in a sidecar of the dataset's own folder."""
    home = folder / "sub-01" / "motion"
    home.mkdir(parents=True)
    (folder / "dataset_description.json").write_text('{"Name": "x", "BIDSVersion": "1.10.0"}')
    (folder / "task-turn_motion.json").write_text('{"SamplingFrequency": 50}')
    stem, g = home / "sub-01_task-turn_tracksys-imu", ACCEL_MS2 / 9.80665
    rows = [
        f"{point}_{kind}_{axis}\t{axis}\t{kind}\t{point}\t{unit}"
        for point in points
        for kind, unit in (("ACCEL", "g"), ("GYRO", "deg/s"))
        for axis in "xyz"
    ]
    Path(f"{stem}_channels.tsv").write_text("\n".join(["name\tcomponent\ttype\ttracked_point\tunits", *rows]))
    np.savetxt(f"{stem}_motion.tsv", np.hstack([g, GYRO_DPS] * len(points)), "%.9f", "\t")
    return Path(f"{stem}_motion.tsv")


def opal5(path: Path, labels: Sequence[str] = ("Lumbar",)) -> Path:
    """APDM's layout, version 5."""
    with h5py.File(path, "w") as file:
        for number, label in enumerate(labels):
            sensor = file.create_group(f"Sensors/{1000 + number}")
            sensor.create_group("Configuration").attrs["Label 0"] = np.bytes_(label)
            _opal(sensor, "Gyroscope", "Accelerometer", "Temperature")
    return path


def opal4(path: Path) -> Path:
    """APDM's layout, versions 2 to 4."""
    with h5py.File(path, "w") as file:
        file.attrs["CaseIdList"], file.attrs["MonitorLabelList"] = [np.bytes_("SI-000111")], [np.bytes_("Chest")]
        sensor = file.create_group("SI-000111")
        _opal(sensor, "Calibrated/Gyroscopes", "Calibrated/Accelerometers", "Calibrated/Temperature")
    return path


def _opal(sensor: Any, gyro: str, accel: str, temperature: str) -> None:
    sensor[gyro], sensor[accel] = RATE, ACCEL_MS2
    sensor[temperature] = np.full((len(TIME), 1), 30.0)
    sensor["Time"] = (T0_NS // 1000 + np.rint(TIME * 1e6)).astype(np.uint64)


def parquet(path: Path) -> Path:
    """A table as pandas writes it: with dates, a column of words, and words within a column of several fields."""
    columns = {f"gyro_{axis} (deg/s)": GYRO_DPS[:, at] for at, axis in enumerate("xyz")}
    columns |= {f"acc_{axis}": ACCEL_MS2[:, at] for at, axis in enumerate("xyz")}
    dates = pa.array(T0_NS + np.rint(TIME * 1e9).astype(np.int64), pa.timestamp("ns"))
    words = pa.array(["turning"] * len(TIME))
    within = pa.StructArray.from_arrays([words], names=["y"])
    columns = {name.replace("acc_", "acc."): column for name, column in columns.items()}
    pq.write_table(pa.table({**columns, "timestamp": dates, "activity": words, "acc": within}), path)
    return path


def cwa(path: Path, *, gyro: bool = True) -> Path:
    """An AX6's file: ranges of 2000 °/s and 16 g at 50 Hz. Source: openmovement, ax3-technical.md."""
    counts = np.rint(np.hstack([GYRO_DPS * 32768 / 2000, ACCEL_MS2 / 9.80665 * 2048])).astype("<i2")
    counts = counts if gyro else counts[:, 3:]
    header = bytearray(1024)
    header[:5] = struct.pack("<2sHB", b"MD", 1020, 0x64)  # an AX6
    header[36] = 0x49
    per, blocks = 480 // (2 * counts.shape[1]), []
    for number, start in enumerate(range(0, len(counts) - per + 1, per)):
        seconds, part = divmod(start, 50)
        when = (24 << 26) | (1 << 22) | (2 << 17) | (3 << 12) | (seconds // 60 << 6) | (seconds % 60)
        # The offset counts the samples from the start of the block to the whole second of its time.
        block = struct.pack(
            "<2sHHIIIHHBBBBhH", b"AX", 508, 0, 1, number, when, (3 << 13) | (2 << 10), 300, 0, 200,
            0x49, 0x62 if gyro else 0x32, -part, per,
        ) + counts[start : start + per].tobytes()  # fmt: skip
        block = block.ljust(510, b"\0")
        total = sum(struct.unpack("<255H", block)) & 0xFFFF
        blocks.append(block + struct.pack("<H", -total & 0xFFFF))
    path.write_bytes(bytes(header) + b"".join(blocks))
    return path
