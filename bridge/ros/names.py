"""ROS 2 names of a ward and its devices, and the zenoh keys that the ROS 2 nodes of a ward use. No I/O."""

import re
from typing import Final

#: root of the liveliness tokens of all ROS 2 nodes
TOKENS: Final = "@ros2_lv"
TRANSFORMS_TOPIC: Final = "/tf"
DIAGNOSTICS_TOPIC: Final = "/diagnostics"


def ros_name(name: str) -> str:
    """Convert an id to a valid ROS 2 name, of letters, digits and single underscores.

    Hyphens become underscores. A name that begins with a digit gets the prefix `d`.
    """
    name = re.sub(r"[-_]+", "_", name)
    return f"d{name}" if name[0].isdigit() else name


def imu_topic(ward: str, device: str) -> str:
    """Return the ROS 2 topic of a device's samples, for example `/ward_3/wrist_01/imu`."""
    return f"/{ros_name(ward)}/{ros_name(device)}/imu"


def key_patterns(ward: str) -> tuple[str, ...]:
    """Return the zenoh key patterns of everything that `truerate outlet ros2` publishes for a ward, in any ROS domain."""
    topics = f"/{ros_name(ward)}/*/imu", TRANSFORMS_TOPIC, DIAGNOSTICS_TOPIC
    return (*(f"*{topic}/**" for topic in topics), f"{TOKENS}/**")
