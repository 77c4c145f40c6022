"""WebSocket server for Foxglove: channels, coordinate frames of devices, and the service that requests a calibration.

The samples of a device are sensor_msgs/msg/Imu messages as CDR, as in recordings and on ROS 2; Foxglove plots this
schema by its field names. foxglove-sdk sends to each client from a bounded queue, and drops the oldest messages of a
client that does not read.
"""

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any, Self

import foxglove
from foxglove.channels import FrameTransformsChannel, LogChannel
from foxglove.messages import FrameTransform, FrameTransforms, Log, LogLevel, Quaternion, Timestamp, Vector3
from foxglove.websocket import Capability, MessageSchema, Service, ServiceRequest, ServiceSchema

from bridge.bus.contract import BusError
from bridge.reasons.catalogue import explain
from bridge.ros import messages
from bridge.ros.imu_rows import ImuRows
from bridge.toml.loader import ConfigError
from bridge.wire.keys import check_id
from bridge.wire.messages import NO_REST_S, Quality, State, Status
from bridge.wire.refusal import Refusal
from estimator.client import Client
from estimator.outlets.ward_feed import Event, Pose, WardFeed

#: messages kept for a client that reads slowly: some eight seconds of twenty devices
BACKLOG = 16_384
_NS = 1_000_000_000
#: last time that a stamp holds, in 2106; later ones are shown as this one
_LAST_NS = (1 << 32) * _NS - 1
_NUMBER, _COUNT, _TEXT = {"type": "number"}, {"type": "integer"}, {"type": "string"}
_VECTOR = {"type": "array", "items": _NUMBER}
_STATUS = {
    "title": "truerate.Status",
    "type": "object",
    "properties": {
        **dict.fromkeys(("device", "state", "quality", "reason", "calibration"), _TEXT),
        **dict.fromkeys(("progress", "evidence_age_s", "temperature_c", "rate_hz"), _NUMBER),
        **dict.fromkeys(("bias_dps", "bias_std_dps", "scale"), _VECTOR),
        **dict.fromkeys(("samples_in", "samples_out"), _COUNT),
    },
}
_REQUEST = {"type": "object", "properties": {"device": _TEXT, "reason": _TEXT}, "required": ["device"]}
_ANSWER = {"type": "object", "properties": {"accepted": {"type": "boolean"}, "message": _TEXT}}


class FoxgloveOutlet:
    """WebSocket server that shows one ward to Foxglove; as a context manager, it ends the server on exit.

    devices: ids, None for all. recalibrate: whether clients may request a calibration.
    Raises ConfigError if it cannot listen on host and port.
    """

    def __init__(
        self, client: Client, devices: Sequence[str] | None, host: str, port: int, *, recalibrate: bool = False
    ) -> None:
        self._client, self._context = client, foxglove.Context()
        self._feed = WardFeed(client, devices, self._left)
        self._imu: dict[str, tuple[foxglove.Channel, messages.ImuEncoder]] = {}
        self._status: dict[str, foxglove.Channel] = {}
        self._frames = FrameTransformsChannel("/tf", context=self._context)
        self._log = LogChannel("/log", context=self._context)
        try:
            self._server = foxglove.start_server(
                name=f"truerate ward {client.ward}",
                host=host,
                port=port,
                context=self._context,
                capabilities=[Capability.Services] if recalibrate else [],
                supported_encodings=["json"] if recalibrate else [],
                services=[_service(self._recalibrate)] if recalibrate else [],
                message_backlog_size=BACKLOG,
            )
        except (RuntimeError, OverflowError) as error:
            why = str(error).removeprefix("FoxgloveError: ")
            raise ConfigError(f"cannot listen on {host}:{port}: {why}; choose another with --host or --port") from None

    @property
    def port(self) -> int:
        """Port on which the server listens."""
        return self._server.port

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()

    def round(self, timeout_s: float) -> None:
        """Wait at most `timeout_s` seconds for samples, then send all new messages to the clients that subscribed.

        Sent are samples, poses, statuses and events.
        """
        poses = dict[str, Pose]()
        for rows in self._feed.samples(timeout_s):
            self._send_samples(rows)
            poses[rows.device] = self._feed.pose(rows)
        if poses:
            self._frames.log(FrameTransforms(transforms=[self._frame(pose) for pose in poses.values()]))
        statuses = self._feed.statuses()
        for status in statuses:
            self._send_status(status)
        for event in self._feed.events(statuses):
            self._send_event(event)

    def _send_samples(self, rows: ImuRows) -> None:
        if (sender := self._imu.get(rows.device)) is None:
            schema = foxglove.Schema(name=messages.IMU, encoding="ros2msg", data=messages.definition(messages.IMU))
            topic = f"/{self._client.ward}/{rows.device}/imu"
            channel = foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=self._context)
            sender = self._imu[rows.device] = channel, messages.ImuEncoder(rows.device)
        channel, encoder = sender
        if channel.has_sinks():
            for time_ns, payload in encoder.encode(rows):
                channel.log(payload, log_time=time_ns)

    def _left(self, device: str) -> None:
        if device in self._imu:
            self._imu.pop(device)[0].close()
        if device in self._status:
            self._status.pop(device).close()

    def _frame(self, pose: Pose) -> FrameTransform:
        (px, py, pz), (w, x, y, z) = pose.position, pose.quat_wxyz
        return FrameTransform(
            timestamp=_stamp(pose.time_ns),
            parent_frame_id=self._client.ward,
            child_frame_id=pose.device,
            translation=Vector3(x=px, y=py, z=pz),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        )

    def _send_status(self, status: Status) -> None:
        channel = self._status.get(status.device)
        if channel is None:
            topic = f"/{self._client.ward}/{status.device}/status"
            channel = self._status[status.device] = foxglove.Channel(topic, schema=_STATUS, context=self._context)
        channel.log(dict(_as_json(status)), log_time=status.time_ns)

    def _send_event(self, event: Event) -> None:
        self._log.log(
            Log(
                timestamp=_stamp(event.time_ns),
                level=LogLevel.Warning if event.serious else LogLevel.Info,
                name=event.device,
                message=event.words,
            ),
            log_time=event.time_ns,
        )

    def _recalibrate(self, request: ServiceRequest) -> bytes:
        """Answer a call of the service, on a thread of foxglove-sdk."""
        try:
            asked = json.loads(request.payload)
            device, reason = check_id(asked["device"], "device"), str(asked.get("reason", ""))
        except (ValueError, TypeError, KeyError, AttributeError):
            return _answer("ask with an object such as {'device': 'chest'}", accepted=False)
        except Refusal as refusal:
            return _answer(refusal.detail, accepted=False)
        try:
            reply = self._client.recalibrate(device, "foxglove", reason)
        except BusError as error:
            return _answer(str(error), accepted=False)
        return _answer(explain(reply.message), accepted=reply.accepted)


def _stamp(time_ns: int) -> Timestamp:
    return Timestamp(*divmod(min(time_ns, _LAST_NS), _NS))


def _as_json(status: Status) -> Iterator[tuple[str, Any]]:
    yield from (("device", status.device), ("state", State(status.state).name))
    yield from (("quality", Quality(status.quality).name), ("reason", explain(status.reason)))
    yield from (("calibration", status.calibration), ("progress", status.progress))
    for name in ("temperature_c", "rate_hz", "samples_in", "samples_out"):
        value = getattr(status, name)
        yield name, None if math.isnan(value) else value  # JSON has no NaN
    yield "evidence_age_s", status.evidence_age_s if status.evidence_age_s < NO_REST_S else None
    yield "bias_dps", [math.degrees(value) for value in status.bias]
    yield "bias_std_dps", [math.degrees(value) for value in status.bias_std]
    yield "scale", list(status.scale)


def _service(handler: Any) -> Service:
    def schema(name: str, shape: dict[str, Any]) -> MessageSchema:
        data = json.dumps({"title": name, **shape}).encode()
        return MessageSchema(encoding="json", schema=foxglove.Schema(name=name, encoding="jsonschema", data=data))

    request, answer = schema("truerate.RecalibrateRequest", _REQUEST), schema("truerate.RecalibrateAnswer", _ANSWER)
    return Service(
        "/recalibrate",
        schema=ServiceSchema("truerate.Recalibrate", request=request, response=answer),
        handler=handler,
    )


def _answer(message: str, *, accepted: bool) -> bytes:
    return json.dumps({"accepted": accepted, "message": message}).encode()
