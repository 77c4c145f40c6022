"""Keys of ROS 2 topics and nodes on zenoh, and message attachments, in the format of rmw_zenoh. No I/O.

Source: docs/design.md and rmw_zenoh_cpp/src/detail of https://github.com/ros2/rmw_zenoh, from version 0.6 (attachments
of 33 bytes) on. Subscribers drop messages without the attachment. xxhash comes with the extra `ros2`.
"""

import struct
from dataclasses import dataclass
from typing import Final

from bridge.ros import messages
from bridge.ros.names import TOKENS

_NODE, _PUBLISHER = "NN", "MP"
#: enclave and namespace of a node that has none
_NONE: Final = "%"
_ATTACHMENT: Final = struct.Struct("<qqB16s")
_GID_BYTES: Final = 16


def topic_key(domain: int, topic: str, kind: str) -> str:
    """Return the zenoh key of a ROS 2 topic: domain, topic without the first slash, DDS name of the type, type hash.

    domain: ROS domain id. kind: message type, such as `sensor_msgs/msg/Imu`.
    """
    return f"{domain}/{topic.strip('/')}/{_dds_type(kind)}/{messages.type_hash(kind)}"


def _dds_type(kind: str) -> str:
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


@dataclass(frozen=True, slots=True)
class Node:
    """ROS 2 node in the root namespace, as rmw_zenoh announces it.

    domain: ROS domain id. session: id of its zenoh session. name: letters, digits and underscores.
    """

    domain: int
    session: str
    name: str

    @property
    def token(self) -> str:
        """Key on zenoh of the liveliness token that announces the node."""
        return self._token(0, _NODE)

    def publisher_token(self, number: int, topic: str, kind: str, depth: int) -> str:
        """Return the zenoh key of the liveliness token that announces a publisher of this node.

        number: number of the publisher in its session, from 1. topic: the ROS 2 topic. kind: message type, such as
        `sensor_msgs/msg/Imu`. depth: number of messages kept for readers. The announced quality of service is reliable and
        volatile.
        """
        mangled = topic.replace("/", "%")
        qos = f"::,{depth}:,:,:,,"  # what is left out has rmw_zenoh's default
        return "/".join((self._token(number, _PUBLISHER), mangled, _dds_type(kind), messages.type_hash(kind), qos))

    def _token(self, number: int, entity: str) -> str:
        return "/".join((TOKENS, str(self.domain), self.session, "0", str(number), entity, _NONE, _NONE, self.name))


def gid(token: str) -> bytes:
    """Return the global id of a publisher, 16 bytes: the 128-bit XXH3 hash of its token, little-endian.

    token: key of the publisher's liveliness token, from `Node.publisher_token`.
    """
    from xxhash import xxh3_128_intdigest  # noqa: PLC0415 - optional extra

    return xxh3_128_intdigest(token.encode()).to_bytes(_GID_BYTES, "little")


def attachment(sequence: int, time_ns: int, of: bytes) -> bytes:
    """Return the attachment of a message, 33 bytes. Subscribers drop messages without it.

    Layout: sequence and time_ns as int64, little-endian; the size of the global id (1 byte); the global id. sequence:
    number of the message from its publisher, from 1. time_ns: ns since the Unix epoch. of: the publisher's global id,
    16 bytes.
    """
    return _ATTACHMENT.pack(sequence, time_ns, _GID_BYTES, of)
