"""Reader of `sensor_msgs/Imu` from ROS 1 bags, ROS 2 bags and .mcap files of ROS 2, by rosbags (the extra `ros`).

An Imu message has rates in rad/s and accelerations in m/s². Its covariance begins with -1 if a sensor is missing.
Source: https://docs.ros.org/en/api/sensor_msgs/html/msg/Imu.html
"""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from bridge.recording.error import RecordingError
from bridge.recording.formats.arrays import table_of
from bridge.recording.formats.streams import choose
from bridge.recording.reading import Reading
from bridge.recording.table import Table

IMU = "sensor_msgs/msg/Imu"
_MISSING = -1.0


def read(path: Path, reading: Reading) -> Table:
    """Read the Imu messages of one topic of a bag as a Table, in SI units.

    `reading.device` names the topic if the bag has several. Raises RecordingError for a damaged bag, a bag without Imu
    messages, or if there are several topics and none is named.
    """
    # Bags of old ROS 2 versions define no types; Imu has been the same in all of them.
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        topics = dict[str, list[Any]]()
        for connection in bag.connections:
            if connection.msgtype == IMU:
                topics.setdefault(connection.topic, []).append(connection)
        connections = choose(path, topics, reading.device, f"topics of {IMU}")
        stamps, received, gyro, accel, missing = list[int](), list[int](), list[Any](), list[Any](), [True, True]
        for connection, received_ns, data in bag.messages(connections):
            message: Any = bag.deserialize(data, connection.msgtype)
            stamp, rate, force = message.header.stamp, message.angular_velocity, message.linear_acceleration
            stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
            received.append(received_ns)
            gyro.append((rate.x, rate.y, rate.z))
            accel.append((force.x, force.y, force.z))
            missing[0] &= message.angular_velocity_covariance[0] == _MISSING
            missing[1] &= message.linear_acceleration_covariance[0] == _MISSING
    if not stamps:
        raise RecordingError(f"{path}: no messages of topic {connections[0].topic}: choose another topic with --device")
    if missing[0]:
        raise RecordingError(
            f"{path}: the messages state that they carry no angular velocity: choose another topic with --device"
        )
    notes, times = list[str](), stamps
    if len(set(stamps)) == 1:
        notes.append("the messages have no time stamps: the times of their recording are used")
        times = received
    first = times[0]
    columns = {"t_s": np.array([time - first for time in times], np.float64) * 1e-9, "gyro_rad_s": np.array(gyro)}
    if not missing[1]:
        columns["accel_m_s2"] = np.array(accel)
    return table_of(path, columns, reading, tick_s=1e-9, notes=notes)
