"""Encoding and decoding of infrequent messages: info, status, calibration, revision, note, command and reply."""

from collections.abc import Sequence

import numpy as np

from bridge.wire import keys, validation
from bridge.wire import truerate_pb2 as pb
from bridge.wire.batches import MAX_CELSIUS, MAX_RATE, MAX_SEQUENCE, MAX_STD
from bridge.wire.envelope import opened, parse_key, read, same_id
from bridge.wire.message_parts import (
    MAX_NIS,
    accelerometer_in,
    accelerometer_message,
    alert_messages,
    alerts_in,
    decoded,
    encoded,
    receipt_messages,
    receipts_in,
)
from bridge.wire.messages import (
    VERSION,
    BiasRevision,
    BootCause,
    Calibration,
    Command,
    CommandReply,
    DeviceCalibration,
    DeviceInfo,
    Note,
    Quality,
    State,
    Status,
    Turn,
    Verdict,
)
from bridge.wire.placement import placement_in, placement_message
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import MAX_PORT, MAX_SENTENCE, MAX_TIME_NS, clean

MIN_POINTS, MAX_POINTS = 2, 1536  # the most that fit into MAX_PAYLOAD with every text
MAX_ELEMENT = 10.0  # magnitude of a matrix element
_MAX_STD = 1e6
_MAX_TURNS = 32
_MAX_PARAMETERS = 32
_MAX_BRIDGES = 16


def encode_info(info: DeviceInfo) -> bytes:
    """Encode a DeviceInfo as bytes, the payload of bus key info/<bridge>/<device>."""
    return pb.DeviceInfo(
        version=VERSION,
        device=info.device,
        bridge=info.bridge,
        boot=info.boot,
        boot_cause=info.boot_cause,  # type: ignore[arg-type] # an int, whatever the stub says
        model=clean(info.model, validation.MAX_NAME),
        firmware=clean(info.firmware, validation.MAX_NAME),
        driver=clean(info.driver, validation.MAX_NAME),
        port=clean(info.port, MAX_PORT),
        rate_hz=info.rate_hz,
        measured_rate_hz=info.measured_rate_hz,
        gyro_range=info.gyro_range,
        has_accel=info.has_accel,
        has_temperature=info.has_temperature,
        time_ns=info.time_ns,
        samples=info.samples,
        dropped=_clean_counts(info.dropped),
        events=_clean_counts(info.events),
        trouble=encoded(info.trouble),
        battery_percent=info.battery_percent,
        charging=info.charging,
        notices=encoded(info.notices),
        has_clock=info.has_clock,
        calibration=_own_message(info.calibration),
    ).SerializeToString()


def decode_info(key: str, payload: bytes) -> DeviceInfo:
    """Decode and validate the payload of bus key info/<bridge>/<device> as a DeviceInfo. Raises Refusal if invalid."""
    raw, place = opened(pb.DeviceInfo, "info", key, payload)
    same_id(raw.bridge, place, "bridge")
    return DeviceInfo(
        device=raw.device,
        bridge=raw.bridge,
        boot=raw.boot,
        boot_cause=validation.member(BootCause, raw.boot_cause, "boot_cause"),
        model=validation.text(raw.model, "model"),
        firmware=validation.text(raw.firmware, "firmware"),
        driver=validation.text(raw.driver, "driver"),
        port=validation.text(raw.port, "port", MAX_PORT),
        rate_hz=validation.number(raw.rate_hz, "rate_hz", 0.0, 1e6),
        measured_rate_hz=validation.number(raw.measured_rate_hz, "measured_rate_hz", 0.0, 1e9),
        gyro_range=validation.number(raw.gyro_range, "gyro_range", 0.0, MAX_RATE),
        has_accel=raw.has_accel,
        has_temperature=raw.has_temperature,
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        samples=raw.samples,
        dropped=validation.counts(raw.dropped, "dropped"),
        events=validation.counts(raw.events, "events"),
        trouble=decoded(raw.trouble, "trouble"),
        battery_percent=validation.number_or_nan(raw.battery_percent, "battery_percent", 0.0, 100.0),
        charging=raw.charging,
        notices=decoded(raw.notices, "notices"),
        has_clock=raw.has_clock,
        calibration=_own_in(raw.calibration) if raw.HasField("calibration") else None,
    )


def _own_message(own: DeviceCalibration | None) -> pb.DeviceCalibration | None:
    if own is None:
        return None
    return pb.DeviceCalibration(boot=own.boot, sequence=own.sequence, scale=own.scale, bias=own.bias)


def _own_in(raw: pb.DeviceCalibration) -> DeviceCalibration:
    return DeviceCalibration(
        boot=raw.boot,
        sequence=raw.sequence,
        scale=tuple(validation.vector(raw.scale, "scale", 3, -10.0, 10.0).tolist()),
        bias=tuple(validation.vector(raw.bias, "bias", 3, -MAX_RATE, MAX_RATE).tolist()),
    )


def encode_status(status: Status) -> bytes:
    """Encode a Status as bytes, the payload of bus key status/<device>."""
    said = pb.Status()  # set field by field, in half the time: once a second for each device
    said.version = VERSION
    said.device, said.boot, said.time_ns = status.device, status.boot, status.time_ns
    said.state = status.state  # type: ignore[assignment] # an int, whatever the stub says
    said.quality = status.quality  # type: ignore[assignment] # an int, whatever the stub says
    said.reason.extend(encoded(status.reason))
    said.progress = status.progress
    said.axes_done.extend(status.axes_done)
    said.bias.extend(status.bias)
    said.bias_std.extend(status.bias_std)
    said.scale.extend(status.scale)
    said.calibration = clean(status.calibration, validation.MAX_NAME)
    said.calibrated_time_ns = status.calibrated_time_ns
    said.evidence_age_s, said.temperature_c, said.rate_hz = status.evidence_age_s, status.temperature_c, status.rate_hz
    said.samples_in, said.samples_out = status.samples_in, status.samples_out
    said.dropped.update(_clean_counts(status.dropped))
    said.events.update(_clean_counts(status.events))
    said.bridge, said.epoch = status.bridge, status.epoch
    said.refused_bridges.extend(status.refused_bridges)
    if status.placement is not None:
        said.placement.CopyFrom(placement_message(status.placement))
    said.alerts.extend(alert_messages(status.alerts))
    if (accelerometer := accelerometer_message(status.accelerometer)) is not None:
        said.accelerometer.CopyFrom(accelerometer)
    said.nis = status.nis
    said.receipts.extend(receipt_messages(status.receipts))
    return said.SerializeToString()


def decode_status(key: str, payload: bytes) -> Status:
    """Decode and validate the payload of bus key status/<device> as a Status. Raises Refusal if invalid."""
    raw, _ = opened(pb.Status, "status", key, payload)
    axes_done = tuple(validation.whole(axis, "axes_done", 2) for axis in raw.axes_done)
    if len(axes_done) > 3:
        raise Refusal(Reason.LENGTH, f"axes_done has {len(axes_done)} values; at most 3 are allowed")
    return Status(
        device=raw.device,
        boot=raw.boot,
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        state=validation.member(State, raw.state, "state"),
        quality=validation.member(Quality, raw.quality, "quality"),
        reason=decoded(raw.reason, "reason"),
        progress=validation.number(raw.progress, "progress", 0.0, 1.0),
        axes_done=axes_done,
        bias=tuple(validation.vector(raw.bias, "bias", 3, -MAX_RATE, MAX_RATE).tolist()),
        bias_std=tuple(validation.vector(raw.bias_std, "bias_std", 3, 0.0, _MAX_STD).tolist()),
        scale=tuple(validation.vector(raw.scale, "scale", 3, -10.0, 10.0).tolist()),
        calibration=validation.text(raw.calibration, "calibration"),
        calibrated_time_ns=validation.time_ns(raw.calibrated_time_ns, "calibrated_time_ns"),
        evidence_age_s=validation.number(raw.evidence_age_s, "evidence_age_s", 0.0, 1e12),
        temperature_c=validation.number_or_nan(raw.temperature_c, "temperature_c", -MAX_CELSIUS, MAX_CELSIUS),
        rate_hz=validation.number(raw.rate_hz, "rate_hz", 0.0, 1e6),
        samples_in=raw.samples_in,
        samples_out=raw.samples_out,
        dropped=validation.counts(raw.dropped, "dropped"),
        events=validation.counts(raw.events, "events"),
        bridge=keys.check_id(raw.bridge, "bridge") if raw.bridge else "",
        refused_bridges=_ids(raw.refused_bridges, "refused_bridges"),
        epoch=validation.whole(raw.epoch, "epoch", validation.MAX_EPOCH),
        placement=placement_in(raw),
        alerts=alerts_in(raw),
        accelerometer=accelerometer_in(raw),
        nis=validation.number(raw.nis, "nis", 0.0, MAX_NIS),
        receipts=receipts_in(raw),
    )


def encode_calibration(calibration: Calibration) -> bytes:
    """Encode a Calibration as bytes, the payload of bus key calibration/<device>."""
    return calibration_message(calibration).SerializeToString()


def calibration_message(calibration: Calibration) -> pb.Calibration:
    """Convert a Calibration to its protobuf message, which is sent alone or inside a checkpoint."""
    return pb.Calibration(
        version=VERSION,
        device=calibration.device,
        boot=calibration.boot,
        id=clean(calibration.id, validation.MAX_NAME),
        time_ns=calibration.time_ns,
        method=clean(calibration.method, validation.MAX_NAME),
        verdict=calibration.verdict,  # type: ignore[arg-type] # an int, whatever the stub says
        reason=encoded(calibration.reason),
        matrix=calibration.matrix.ravel().tolist(),
        bias=calibration.bias.tolist(),
        parameters=[clean(name, validation.MAX_NAME) for name in calibration.parameters],
        covariance=calibration.covariance.ravel().tolist(),
        turns=[
            pb.Turn(axis=t.axis, angle=t.angle, closure_error=t.closure_error, duration_s=t.duration_s)
            for t in calibration.turns
        ],
        noise_std=calibration.noise_std.tolist(),
        model=clean(calibration.model, validation.MAX_NAME),
        firmware=clean(calibration.firmware, validation.MAX_NAME),
        gyro_range=calibration.gyro_range,
        rate_hz=calibration.rate_hz,
        temperature_c=calibration.temperature_c,
        who=clean(calibration.who, validation.MAX_NAME),
        epoch=calibration.epoch,
        accelerometer=accelerometer_message(calibration.accelerometer),
    )


def decode_calibration(key: str, payload: bytes) -> Calibration:
    """Decode and validate the payload of bus key calibration/<device> as a Calibration. Raises Refusal if invalid."""
    raw, _ = opened(pb.Calibration, "calibration", key, payload)
    return calibration_in(raw)


def calibration_in(raw: pb.Calibration) -> Calibration:
    """Validate a protobuf calibration, alone or inside a checkpoint, and convert it to a Calibration.

    Raises Refusal for an invalid calibration.
    """
    n = len(raw.parameters)
    if n > _MAX_PARAMETERS or len(raw.turns) > _MAX_TURNS:
        raise Refusal(
            Reason.LENGTH, f"{n} parameters and {len(raw.turns)} turns are given; at most 32 of each are allowed"
        )
    return Calibration(
        device=raw.device,
        boot=raw.boot,
        id=validation.text(raw.id, "id"),
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        method=validation.text(raw.method, "method"),
        verdict=validation.member(Verdict, raw.verdict, "verdict"),
        reason=decoded(raw.reason, "reason"),
        matrix=validation.vector(raw.matrix, "matrix", 9, -10.0, 10.0).reshape(3, 3),
        bias=validation.vector(raw.bias, "bias", 3, -MAX_RATE, MAX_RATE),
        parameters=tuple(validation.text(name, "a parameter") for name in raw.parameters),
        covariance=validation.vector(raw.covariance, "covariance", n * n, -_MAX_STD, _MAX_STD).reshape(n, n),
        turns=tuple(_turn(turn) for turn in raw.turns),
        noise_std=validation.vector(raw.noise_std, "noise_std", 3, 0.0, _MAX_STD),
        model=validation.text(raw.model, "model"),
        firmware=validation.text(raw.firmware, "firmware"),
        gyro_range=validation.number(raw.gyro_range, "gyro_range", 0.0, MAX_RATE),
        rate_hz=validation.number(raw.rate_hz, "rate_hz", 0.0, 1e6),
        temperature_c=validation.number_or_nan(raw.temperature_c, "temperature_c", -MAX_CELSIUS, MAX_CELSIUS),
        who=validation.text(raw.who, "who"),
        epoch=validation.whole(raw.epoch, "epoch", validation.MAX_EPOCH),
        accelerometer=accelerometer_in(raw),
    )


def encode_note(note: Note) -> bytes:
    """Encode a Note as bytes, the payload of bus key note/<device>.

    Texts are made printable, and shortened to the largest allowed length.
    """
    return pb.Note(
        version=VERSION,
        device=note.device,
        boot=note.boot,
        time_ns=note.time_ns,
        who=clean(note.who, validation.MAX_NAME),
        text=clean(note.text, MAX_SENTENCE),
    ).SerializeToString()


def decode_note(key: str, payload: bytes) -> Note:
    """Decode and validate the payload of bus key note/<device> as a Note. Raises Refusal if invalid."""
    raw, _ = opened(pb.Note, "note", key, payload)
    return Note(
        device=raw.device,
        boot=raw.boot,
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        who=validation.text(raw.who, "who"),
        text=validation.text(raw.text, "text", MAX_SENTENCE),
    )


def encode_command(command: Command) -> bytes:
    """Encode a Command as bytes, the payload of a query to bus key rpc/<device>/<verb>."""
    return pb.Command(
        version=VERSION,
        request_id=clean(command.request_id, validation.MAX_NAME),
        who=clean(command.who, validation.MAX_NAME),
        reason=clean(command.reason, MAX_SENTENCE),
        placement=None if command.placement is None else placement_message(command.placement),
    ).SerializeToString()


def decode_command(key: str, payload: bytes) -> Command:
    """Decode and validate the payload of a query to bus key rpc/<device>/<verb> as a Command.

    Raises Refusal for an invalid command, for a verb that is not in keys.VERBS, and without a request id.
    """
    place = parse_key(key, "rpc")
    if place.ids["verb"] not in keys.VERBS:
        raise Refusal(Reason.BAD_KEY, f"unknown command {place.ids['verb']!r}: use {', '.join(keys.VERBS)}")
    raw = read(pb.Command, payload)
    if not raw.request_id:
        raise Refusal(Reason.LENGTH, "a command needs a request id")
    return Command(
        request_id=validation.text(raw.request_id, "request_id"),
        who=validation.text(raw.who, "who"),
        reason=validation.text(raw.reason, "reason", MAX_SENTENCE),
        placement=placement_in(raw),
    )


def encode_reply(reply: CommandReply) -> bytes:
    """Encode a CommandReply as bytes, the answer to a command's query. The result is never empty."""
    return pb.CommandReply(
        version=VERSION,
        request_id=clean(reply.request_id, validation.MAX_NAME),
        accepted=reply.accepted,
        message=encoded(reply.message),
    ).SerializeToString()


def decode_reply(payload: bytes) -> CommandReply:
    """Decode and validate the answer to a command's query as a CommandReply. Raises Refusal if invalid."""
    raw = read(pb.CommandReply, payload)
    return CommandReply(
        request_id=validation.text(raw.request_id, "request_id"),
        accepted=raw.accepted,
        message=decoded(raw.message, "message"),
    )


def _turn(raw: pb.Turn) -> Turn:
    return Turn(
        axis=validation.whole(raw.axis, "axis", 2),
        angle=validation.number(raw.angle, "angle", -100.0, 100.0),
        closure_error=validation.number(raw.closure_error, "closure_error", 0.0, 100.0),
        duration_s=validation.number(raw.duration_s, "duration_s", 0.0, 1e6),
    )


def _ids(values: Sequence[str], name: str) -> tuple[str, ...]:
    if len(values) > _MAX_BRIDGES:
        raise Refusal(Reason.LENGTH, f"{name} has {len(values)} values; at most {_MAX_BRIDGES} are allowed")
    return tuple(keys.check_id(value, f"one of {name}") for value in values)


def _clean_counts(counts: dict[str, int]) -> dict[str, int]:
    return {clean(label, validation.MAX_NAME): n for label, n in counts.items()}


def encode_revision(revision: BiasRevision) -> bytes:
    """Encode a BiasRevision as bytes, the payload of bus key revision/<device>."""
    return pb.BiasRevision(
        version=VERSION,
        device=revision.device,
        boot=revision.boot,
        calibration=clean(revision.calibration, validation.MAX_NAME),
        time_ns=revision.time_ns,
        matrix=revision.matrix.ravel().tolist(),
        sequences=revision.sequences.tolist(),
        times_ns=revision.times_ns.tolist(),
        bias=revision.bias.ravel().tolist(),
        bias_std=revision.bias_std.ravel().tolist(),
        reason=encoded(revision.reason),
    ).SerializeToString()


def decode_revision(key: str, payload: bytes) -> BiasRevision:
    """Decode and validate the payload of bus key revision/<device> as a BiasRevision. Raises Refusal if invalid."""
    raw, _ = opened(pb.BiasRevision, "revision", key, payload)
    n = len(raw.sequences)
    if not MIN_POINTS <= n <= MAX_POINTS:
        raise Refusal(Reason.LENGTH, f"the revision has {n} points: use {MIN_POINTS} to {MAX_POINTS}")
    if len(raw.times_ns) != n:
        raise Refusal(Reason.LENGTH, f"times_ns has {len(raw.times_ns)} values; {n} are expected")
    bias = validation.vector(raw.bias, "bias", 3 * n, -MAX_RATE, MAX_RATE)
    bias_std = validation.vector(raw.bias_std, "bias_std", 3 * n, 0.0, MAX_STD)
    return BiasRevision(
        device=raw.device,
        boot=raw.boot,
        calibration=validation.text(raw.calibration, "calibration"),
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        matrix=validation.vector(raw.matrix, "matrix", 9, -MAX_ELEMENT, MAX_ELEMENT).reshape(3, 3),
        sequences=np.array(validation.rising(raw.sequences, "sequences", MAX_SEQUENCE), np.uint64),
        times_ns=np.array(validation.rising(raw.times_ns, "times_ns", MAX_TIME_NS), np.int64),
        bias=bias.astype(np.float32).reshape(n, 3),
        bias_std=bias_std.astype(np.float32).reshape(n, 3),
        reason=decoded(raw.reason, "reason"),
    )
