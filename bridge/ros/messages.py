"""ROS 2 messages as CDR bytes, their definitions and their type hashes, all made by the package rosbags (extra `ros`).

Conventions for inertial data: REP-145, https://www.ros.org/reps/rep-0145.html. An unknown covariance is zero. If a
quantity itself is unknown, element 0 of its covariance is -1. Type hashes: REP-2016.
"""

import functools
import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from bridge.ros.imu_rows import ImuRows

IMU: Final = "sensor_msgs/msg/Imu"
TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
DIAGNOSTICS: Final = "diagnostic_msgs/msg/DiagnosticArray"
NEEDS: Final = "needs another package: pip install 'truerate[ros]'"
#: levels of a diagnostic status, in diagnostic_msgs/msg/DiagnosticStatus
OK, WARN, ERROR, STALE = range(4)
_NS: Final = 1_000_000_000
#: last time that a stamp holds, in 2038; later ones are shown as this one
_LAST_NS: Final = (1 << 31) * _NS - 1


def available() -> bool:
    """Return True if rosbags, the optional package that encodes ROS 2 messages, is installed."""
    return importlib.util.find_spec("rosbags") is not None


@functools.cache
def _store() -> Any:
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - optional extra

    return get_typestore(Stores.ROS2_JAZZY)


@functools.cache
def definition(kind: str) -> bytes:
    """Return the definition of a message type, such as `sensor_msgs/msg/Imu`, as UTF-8 in MCAP's format `ros2msg`."""
    text: str = _store().generate_msgdef(kind, ros_version=2)[0]
    return text.encode()


def type_hash(kind: str) -> str:
    """Return the REP-2016 hash of a message type, such as `sensor_msgs/msg/Imu`: RIHS01_ and 64 hexadecimal digits."""
    return str(_store().hash_rihs01(kind))


def _encoded(kind: str, message: object) -> bytes:
    return bytes(_store().serialize_cdr(message, kind, little_endian=True))


def _header(frame_id: str, time_ns: int = 0) -> Any:
    types = _store().types
    sec, nanosec = divmod(min(time_ns, _LAST_NS), _NS)
    stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


class ImuEncoder:
    """Encoder of one device's samples as sensor_msgs/msg/Imu messages.

    frame_id: name of the sensor's frame, written to the header of each message.
    """

    def __init__(self, frame_id: str) -> None:
        types = _store().types
        vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
        self._imu = types[IMU](
            header=_header(frame_id),
            orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=vector(x=0.0, y=0.0, z=0.0),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(x=0.0, y=0.0, z=0.0),
            linear_acceleration_covariance=np.zeros(9),
        )

    def encode(self, rows: ImuRows) -> Iterator[tuple[int, bytes]]:
        """Yield, for each sample, its host time (ns since the Unix epoch) and one sensor_msgs/msg/Imu message as CDR bytes.

        Rates are in rad/s, accelerations in m/s². For an unknown acceleration or orientation, element 0 of its
        covariance is -1.
        """
        imu = self._imu
        stamp, rate, accel, turned = (
            imu.header.stamp, imu.angular_velocity, imu.linear_acceleration, imu.orientation,
        )  # fmt: skip
        attitude_cov = rows.attitude_cov.ravel()
        variances = np.zeros_like(rows.rate) if rows.rate_var is None else rows.rate_var
        columns = (rows.time_ns.tolist(), rows.rate.tolist(), variances, rows.accel.tolist(), rows.quat_wxyz.tolist())
        for time_ns, rates, rate_var, (ax, ay, az), (w, x, y, z) in zip(*columns, strict=True):
            stamp.sec, stamp.nanosec = divmod(min(time_ns, _LAST_NS), _NS)
            rate.x, rate.y, rate.z = rates
            imu.angular_velocity_covariance[::4] = rate_var
            if ax == ax:  # noqa: PLR0124 - not NaN
                accel.x, accel.y, accel.z = ax, ay, az
                imu.linear_acceleration_covariance[0] = 0.0
            else:
                accel.x = accel.y = accel.z = 0.0
                imu.linear_acceleration_covariance[0] = -1.0
            if w == w:  # noqa: PLR0124
                turned.w, turned.x, turned.y, turned.z = w, x, y, z
                imu.orientation_covariance[:] = attitude_cov
            else:
                turned.w, turned.x, turned.y, turned.z = 1.0, 0.0, 0.0, 0.0
                imu.orientation_covariance[:] = 0.0
                imu.orientation_covariance[0] = -1.0
            yield time_ns, _encoded(IMU, imu)


class Transform(NamedTuple):
    """Pose of the frame `child` in the frame `parent`.

    time_ns: host time, ns since the Unix epoch. position: x, y, z in m. quat_wxyz: unit quaternion, scalar first.
    """

    time_ns: int
    parent: str
    child: str
    position: tuple[float, float, float]
    quat_wxyz: tuple[float, float, float, float]


def encode_transforms(transforms: Sequence[Transform]) -> bytes:
    """Encode poses as one tf2_msgs/msg/TFMessage; return its CDR bytes."""
    types = _store().types
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    made = []
    for time_ns, parent, child, (px, py, pz), (w, x, y, z) in transforms:
        transform = types["geometry_msgs/msg/Transform"](
            translation=vector(x=px, y=py, z=pz), rotation=quaternion(x=x, y=y, z=z, w=w)
        )
        stamped = types["geometry_msgs/msg/TransformStamped"]
        made.append(stamped(header=_header(parent, time_ns), child_frame_id=child, transform=transform))
    return _encoded(TRANSFORMS, types[TRANSFORMS](transforms=made))


class Diagnosis(NamedTuple):
    """State of one device: level (OK, WARN, ERROR or STALE), message, and further values by name.

    The fields are those of diagnostic_msgs/msg/DiagnosticStatus.
    """

    name: str
    level: int
    message: str
    hardware_id: str
    values: Mapping[str, str]


def encode_diagnostics(time_ns: int, found: Sequence[Diagnosis]) -> bytes:
    """Encode the states of devices as one diagnostic_msgs/msg/DiagnosticArray; return its CDR bytes.

    found: the states. time_ns: time of the message, ns since the Unix epoch.
    """
    types = _store().types
    pair = types["diagnostic_msgs/msg/KeyValue"]
    statuses = [
        types["diagnostic_msgs/msg/DiagnosticStatus"](
            level=one.level,
            name=one.name,
            message=one.message,
            hardware_id=one.hardware_id,
            values=[pair(key=key, value=value) for key, value in one.values.items()],
        )
        for one in found
    ]
    return _encoded(DIAGNOSTICS, types[DIAGNOSTICS](header=_header("", time_ns), status=statuses))
