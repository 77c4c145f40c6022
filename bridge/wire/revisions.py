"""Encoding and decoding of bias revisions: a few per hour, each up to MAX_PAYLOAD bytes."""

import numpy as np

from bridge.wire import truerate_pb2 as pb
from bridge.wire import validation
from bridge.wire.batches import MAX_RATE, MAX_SEQUENCE, MAX_STD
from bridge.wire.envelope import opened
from bridge.wire.message_parts import decoded, encoded
from bridge.wire.messages import VERSION, BiasRevision
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import MAX_TIME_NS, clean

MIN_POINTS, MAX_POINTS = 2, 1536  # the most that fit into MAX_PAYLOAD with every text
MAX_ELEMENT = 10.0  # magnitude of a matrix element


def encode_revision(revision: BiasRevision) -> bytes:
    """Encode a BiasRevision as bytes, the payload of revision/<device>."""
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
    """Decode and validate the payload of revision/<device> as a BiasRevision. Raises Refusal if invalid."""
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
