"""Encoding and decoding of messages between estimators: lists of owned devices, and checkpoints."""

from bridge.wire import keys, validation
from bridge.wire import truerate_pb2 as pb
from bridge.wire.batches import MAX_SEQUENCE
from bridge.wire.control_messages import calibration_in, calibration_message
from bridge.wire.envelope import opened
from bridge.wire.message_parts import alert_messages, alerts_in, decoded, encoded
from bridge.wire.messages import VERSION, Calibration, Checkpoint, CommandReply, Holding, Move, Owned, Verdict
from bridge.wire.placement import placement_in, placement_message
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import MAX_EPOCH

MAX_HOLDINGS, MAX_MOVES, MAX_PARTS, MAX_ANSWERS = 512, 8, 64, 8
#: bytes of a session's state; a larger state is left out, and a takeover has only the calibration
MAX_STATE = 56_000
_MAX_LOAD = 1e4
#: parameters that every calibration method determines, first in the covariance
_DETERMINED = ("bias_x", "bias_y", "bias_z", "k_x", "k_y", "k_z")


def encode_owned(owned: Owned) -> bytes:
    """Encode an Owned message, the list of an estimator's devices, as the payload of bus key owned/<estimator>."""
    return pb.Owned(
        version=VERSION,
        estimator=owned.estimator,
        time_ns=owned.time_ns,
        epoch=owned.epoch,
        load=owned.load,
        part=owned.part,
        parts=owned.parts,
        holdings=[
            pb.Holding(device=h.device, epoch=h.epoch, boot=h.boot, next=h.next, busy=h.busy) for h in owned.holdings
        ],
        moves=[pb.Move(time_ns=m.time_ns, came=m.came, left=m.left, reason=encoded(m.reason)) for m in owned.moves],
        alerts=alert_messages(owned.alerts),
    ).SerializeToString()


def decode_owned(key: str, payload: bytes) -> Owned:
    """Decode and validate the payload of bus key owned/<estimator> as an Owned message. Raises Refusal if invalid."""
    raw, _ = opened(pb.Owned, "owned", key, payload, "estimator")
    if len(raw.holdings) > MAX_HOLDINGS or len(raw.moves) > MAX_MOVES:
        raise Refusal(
            Reason.LENGTH,
            f"{len(raw.holdings)} holdings and {len(raw.moves)} moves are given; at most "
            f"{MAX_HOLDINGS} and {MAX_MOVES} are allowed",
        )
    parts = validation.whole(raw.parts, "parts", MAX_PARTS)
    return Owned(
        estimator=raw.estimator,
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        epoch=validation.whole(raw.epoch, "epoch", MAX_EPOCH),
        load=validation.number(raw.load, "load", 0.0, _MAX_LOAD),
        holdings=tuple(_holding(h) for h in raw.holdings),
        moves=tuple(_move(m) for m in raw.moves),
        part=validation.whole(raw.part, "part", max(0, parts - 1)),
        parts=parts,
        alerts=alerts_in(raw),
    )


def encode_checkpoint(checkpoint: Checkpoint) -> bytes:
    """Encode a Checkpoint as bytes, the payload of bus key checkpoint/<device>.

    Of the answers (verb and reply of a command), only the last MAX_ANSWERS are encoded. A `state` of more than
    MAX_STATE bytes is left out.
    """
    return pb.Checkpoint(
        version=VERSION,
        device=checkpoint.device,
        boot=checkpoint.boot,
        epoch=checkpoint.epoch,
        time_ns=checkpoint.time_ns,
        bridge=checkpoint.bridge,
        calibration=None if checkpoint.calibration is None else calibration_message(checkpoint.calibration),
        answers=[_answer_of(verb, reply) for verb, reply in checkpoint.answers[-MAX_ANSWERS:]],
        boot_repeated=checkpoint.boot_repeated,
        state=checkpoint.state if len(checkpoint.state) <= MAX_STATE else b"",
        placement=None if checkpoint.placement is None else placement_message(checkpoint.placement),
        alerts=alert_messages(checkpoint.alerts),
    ).SerializeToString()


def decode_checkpoint(key: str, payload: bytes) -> Checkpoint:
    """Decode and validate the payload of bus key checkpoint/<device> as a Checkpoint.

    The bytes of `state` are not checked. Raises Refusal if another field is invalid.
    """
    raw, _ = opened(pb.Checkpoint, "checkpoint", key, payload)
    return Checkpoint(
        device=raw.device,
        boot=raw.boot,
        epoch=validation.whole(raw.epoch, "epoch", MAX_EPOCH),
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        bridge=keys.check_id(raw.bridge, "bridge") if raw.bridge else "",
        calibration=_in_use(calibration_in(raw.calibration), raw.device) if raw.HasField("calibration") else None,
        answers=tuple(_answer(answer) for answer in raw.answers[-MAX_ANSWERS:]),
        boot_repeated=raw.boot_repeated,
        state=raw.state,
        placement=placement_in(raw),
        alerts=alerts_in(raw),
    )


def _answer_of(verb: str, reply: CommandReply) -> pb.Answer:
    message = encoded(reply.message)
    return pb.Answer(verb=verb, request_id=reply.request_id, accepted=reply.accepted, message=message)


def _answer(raw: pb.Answer) -> tuple[str, CommandReply]:
    request_id, message = validation.text(raw.request_id, "request_id"), decoded(raw.message, "message")
    return validation.text(raw.verb, "verb"), CommandReply(request_id, raw.accepted, message)


def _in_use(calibration: Calibration, device: str) -> Calibration:
    """Return the calibration if it can correct the device: accepted, and with all parameters. Raises Refusal."""
    if calibration.device != device:
        raise Refusal(Reason.FOREIGN_ID, f"the calibration is of {calibration.device[:64]!r}, not of {device!r}")
    if calibration.verdict is not Verdict.ACCEPTED or calibration.parameters[: len(_DETERMINED)] != _DETERMINED:
        said = f"{calibration.verdict.name}, of {', '.join(calibration.parameters) or 'nothing'}"
        raise Refusal(Reason.RANGE, f"the calibration is {said}; ACCEPTED, of {', '.join(_DETERMINED)} is expected")
    return calibration


def _holding(raw: pb.Holding) -> Holding:
    return Holding(
        device=keys.check_id(raw.device, "a device"),
        epoch=validation.whole(raw.epoch, "epoch", MAX_EPOCH),
        boot=raw.boot,
        next=validation.whole(raw.next, "next", 2 * MAX_SEQUENCE),
        busy=raw.busy,
    )


def _move(raw: pb.Move) -> Move:
    return Move(
        time_ns=validation.time_ns(raw.time_ns, "time_ns"),
        came=raw.came,
        left=raw.left,
        reason=decoded(raw.reason, "reason"),
    )
