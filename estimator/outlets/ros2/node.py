"""ROS 2 node of a ward: publishes samples, poses and diagnostics on zenoh as a node with rmw_zenoh does."""

import logging
import math
import time
from collections.abc import Sequence
from typing import Final

from bridge.bus.zenoh_bus import ZenohBus
from bridge.reasons.catalogue import explain
from bridge.ros import messages, rmw_zenoh
from bridge.ros.imu_rows import ImuRows
from bridge.ros.messages import Diagnosis, Transform
from bridge.ros.names import DIAGNOSTICS_TOPIC, TRANSFORMS_TOPIC, imu_topic, ros_name
from bridge.wire.messages import Quality, State, Status
from estimator.client import Client
from estimator.outlets.ward_feed import WardFeed

_log = logging.getLogger(__name__)
_LEVELS: Final = {State.TRACKING: messages.OK, State.LOST: messages.ERROR, State.UNKNOWN: messages.STALE}
#: messages that a subscriber need not keep more of; of transforms as tf2 has it
_DEPTH, _TRANSFORMS_DEPTH = 10, 100


class _Publisher:
    """A ROS 2 publisher: its liveliness token, and the attachment of each message."""

    def __init__(
        self, bus: ZenohBus, node: rmw_zenoh.Node, number: int, topic: str, kind: str, depth: int = _DEPTH
    ) -> None:
        self._publisher = bus.publisher(rmw_zenoh.topic_key(node.domain, topic, kind))
        token = node.publisher_token(number, topic, kind, depth)
        self._token, self._gid, self._sent = bus.declare_alive(token), rmw_zenoh.gid(token), 0

    @property
    def wanted(self) -> bool:
        """True if a subscriber exists now."""
        return self._publisher.wanted

    def put(self, payload: bytes) -> None:
        """Publish a CDR message."""
        self._sent += 1
        self._publisher.put(payload, rmw_zenoh.attachment(self._sent, time.time_ns(), self._gid))

    def close(self) -> None:
        """End the publisher."""
        self._token.close()
        self._publisher.close()


class Ros2Outlet:
    """ROS 2 node of one ward. Call `round` repeatedly; closing `bus` ends the node.

    devices: ids, None for all. bus: session on the ROS 2 router. domain: ROS domain, 0 to 232.
    """

    def __init__(self, client: Client, devices: Sequence[str] | None, bus: ZenohBus, domain: int) -> None:
        self._ward, self._bus = client.ward, bus
        self._feed = WardFeed(client, devices, self._left)
        self._node = rmw_zenoh.Node(domain, bus.session_id, f"truerate_{ros_name(client.ward)}")
        self._token = bus.declare_alive(self._node.token)
        self._count = 0
        self._frames = self._publish(TRANSFORMS_TOPIC, messages.TRANSFORMS, _TRANSFORMS_DEPTH)
        self._diagnostics = self._publish(DIAGNOSTICS_TOPIC, messages.DIAGNOSTICS)
        self._imu: dict[str, tuple[_Publisher, messages.ImuEncoder] | None] = {}
        self._topics: dict[str, str] = {}

    @property
    def name(self) -> str:
        """Name of the ROS 2 node."""
        return self._node.name

    def round(self, timeout_s: float) -> None:
        """Wait at most `timeout_s` seconds for samples, then publish samples, poses and diagnostics to subscribers."""
        poses = dict[str, Transform]()
        for rows in self._feed.samples(timeout_s):
            self._put_samples(rows)
            _, time_ns, position, quat_wxyz = self._feed.pose(rows)
            poses[rows.device] = Transform(time_ns, self._ward, rows.device, position, quat_wxyz)
        if poses and self._frames.wanted:
            self._frames.put(messages.encode_transforms(list(poses.values())))
        statuses = self._feed.statuses()
        if statuses and self._diagnostics.wanted:
            self._diagnostics.put(messages.encode_diagnostics(time.time_ns(), [self._diagnosis(s) for s in statuses]))

    def _publish(self, topic: str, kind: str, depth: int = _DEPTH) -> _Publisher:
        self._count += 1
        return _Publisher(self._bus, self._node, self._count, topic, kind, depth)

    def _put_samples(self, rows: ImuRows) -> None:
        device = rows.device
        if device not in self._imu:
            topic = imu_topic(self._ward, device)
            owner = self._topics.setdefault(topic, device)
            if owner != device:
                _log.error("devices %s and %s have the same topic %s: rename one of them", owner, device, topic)
            own = owner == device
            self._imu[device] = (self._publish(topic, messages.IMU), messages.ImuEncoder(device)) if own else None
        sender = self._imu[device]
        if sender is not None and sender[0].wanted:
            for _, payload in sender[1].encode(rows):
                sender[0].put(payload)

    def _left(self, device: str) -> None:
        if (sender := self._imu.pop(device, None)) is not None:
            sender[0].close()
            del self._topics[imu_topic(self._ward, device)]

    def _diagnosis(self, status: Status) -> Diagnosis:
        state, quality = State(status.state), Quality(status.quality)
        values = {
            "state": state.name,
            "quality": quality.name,
            "bias_dps": ", ".join(f"{math.degrees(value):.4f}" for value in status.bias),
            "bias_std_dps": ", ".join(f"{math.degrees(value):.4f}" for value in status.bias_std),
            "rate_hz": f"{status.rate_hz:g}",
            "samples_in": str(status.samples_in),
            "calibration": status.calibration,
        }
        level = _LEVELS.get(state, messages.WARN)
        return Diagnosis(f"{self._ward}/{status.device}", level, explain(status.reason), status.device, values)
