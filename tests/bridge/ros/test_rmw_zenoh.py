"""Keys, tokens, attachments, type hashes and CDR against published examples of rmw_zenoh and ROS 2, byte for byte."""

import math
import struct

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from bridge.ros import messages
from bridge.ros.imu_rows import ImuRows
from bridge.ros.messages import Diagnosis, ImuEncoder, Transform
from bridge.ros.names import imu_topic, ros_name
from bridge.ros.rmw_zenoh import Node, attachment, gid, topic_key

STRING = "std_msgs/msg/String"
# docs/design.md of https://github.com/ros2/rmw_zenoh
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
LISTENER = "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
    f"{HASH}/::,7:,:,:,,"
)


def test_keys_and_tokens_are_those_of_the_design_document() -> None:
    assert topic_key(0, "/chatter", STRING) == f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
    assert topic_key(0, "/robot1/chatter", STRING) == f"0/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"
    assert Node(2, "aac3178e146ba6f1fc6e6a4085e77f21", "listener").token == LISTENER
    talker = Node(2, "8b20917502ee955ac4476e0266340d5c", "talker")
    assert talker.publisher_token(10, "/chatter", STRING, 7) == TALKER


@pytest.mark.parametrize(
    ("kind", "published"),
    [
        (messages.IMU, "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"),
        (messages.TRANSFORMS, "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"),
        (messages.DIAGNOSTICS, "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
    ],
)
def test_type_hashes_are_those_that_ros_2_shows(kind: str, published: str) -> None:
    """As `ros2 topic info -v` prints them on Jazzy and later."""
    assert messages.type_hash(kind) == f"RIHS01_{published}"


def test_a_publishers_id_is_the_hash_that_rmw_zenoh_computes() -> None:
    """Expected: printed by rmw_zenoh's own simplified_xxhash3.cpp (commit 97aed48), for each length that it treats apart."""
    long = Node(0, "100f0e0d0c0b0a090807060504030201", "truerate_a-ward-with-a-long-name")
    token = long.publisher_token(11, "/a-ward-with-a-long-name/device-number-one/imu", messages.IMU, 10)
    assert len(token) > 240
    assert gid(LISTENER).hex() == "49877999dacb858702d11ac823785912"
    assert gid(TALKER).hex() == "ac170f31eadcd9ff0cd86d7a17907d1c"
    assert gid(token).hex() == "cbb505c7533850a6fa7a548f51e78af7"


def test_an_attachment_is_what_rmw_zenoh_sends() -> None:
    """Captured from rmw_zenoh 0.10.5 of ROS 2 Lyrical by christomaszewski/dashboard, app/src/services/attachment.test.ts."""
    captured = "0900000000000000df8ab6f7e735d31810fe98e4a3b54b6e599c5934f4cfc25343"
    of = bytes.fromhex("fe98e4a3b54b6e599c5934f4cfc25343")
    assert attachment(9, 1_788_832_747_405_871_839, of).hex() == captured


def rows(device: str = "imu_link") -> ImuRows:
    time_ns = np.array([1_700_000_000_123_456_789])
    rate, accel = np.array([[0.4, 0.5, 0.6]]), np.array([[0.7, 0.8, 9.81]])
    quat_wxyz = np.array([[math.sqrt(1 - 0.14), 0.1, 0.2, 0.3]])
    return ImuRows(device, 1, 0, time_ns, rate, np.zeros((1, 3)), accel, quat_wxyz, np.zeros((3, 3)))


def test_an_imu_is_what_a_publisher_in_rclpy_sends() -> None:
    """Captured on ROS 2 Jazzy by open-vehicle-control-system/ovcs, bridges/ros_bridge/test/…/imu_test.exs; padding zeroed."""
    captured = (
        "00f1536515cd5b0709000000696d755f6c696e6b00000000"
        "9a9999999999b93f9a9999999999c93f333333333333d33f86f3ebc1f2aced3f" + "00" * 72
        + "9a9999999999d93f000000000000e03f333333333333e33f" + "00" * 72
        + "666666666666e63f9a9999999999e93f1f85eb51b89e2340" + "00" * 72
    )  # fmt: skip
    ((time_ns, payload),) = ImuEncoder("imu_link").encode(rows())
    assert time_ns == 1_700_000_000_123_456_789
    assert payload.hex() == "00010000" + captured


def test_what_is_unknown_is_marked_as_rep_145_asks() -> None:
    known = rows()
    unknown = known._replace(accel=known.accel * np.nan, quat_wxyz=known.quat_wxyz * np.nan, rate_var=None)
    encoder = ImuEncoder("chest")
    store = get_typestore(Stores.ROS2_JAZZY)
    imus = [
        store.deserialize_cdr(payload, messages.IMU) for one in (unknown, known) for _, payload in encoder.encode(one)
    ]
    firsts = [
        (imu.orientation_covariance[0], imu.angular_velocity_covariance[0], imu.linear_acceleration_covariance[0])  # type: ignore[attr-defined]
        for imu in imus
    ]
    assert firsts == [(-1.0, 0.0, -1.0), (0.0, 0.0, 0.0)]


def test_poses_and_diagnostics_are_read_back() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    pose = Transform(1_000_000_001, "ward", "chest", (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    (frame,) = store.deserialize_cdr(messages.encode_transforms([pose]), messages.TRANSFORMS).transforms  # type: ignore[attr-defined]
    assert (frame.header.frame_id, frame.child_frame_id, frame.header.stamp.nanosec) == ("ward", "chest", 1)
    assert (frame.transform.translation.z, frame.transform.rotation.w) == (3.0, 1.0)
    found = Diagnosis("ward/chest", messages.WARN, "turn it", "chest", {"state": "TURNING"})
    payload = messages.encode_diagnostics(2_000_000_000, [found])
    assert struct.unpack_from("<II", payload, 4) == (2, 0)
    (status,) = store.deserialize_cdr(payload, messages.DIAGNOSTICS).status  # type: ignore[attr-defined]
    assert (status.level, status.name, status.message) == (messages.WARN, "ward/chest", "turn it")
    assert [(one.key, one.value) for one in status.values] == [("state", "TURNING")]


def test_ids_become_names_that_ros_2_takes() -> None:
    assert [ros_name(name) for name in ("chest", "wrist-left", "a--b_", "3rd")] == [
        "chest",
        "wrist_left",
        "a_b_",
        "d3rd",
    ]
    assert imu_topic("ward-3", "chest-01") == "/ward_3/chest_01/imu"
