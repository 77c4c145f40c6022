"""Codec of bus messages: functions that encode messages to bytes, and decode and validate bytes.

Encoding does not validate the program's own values, but makes texts printable. Decoding validates every field:
`decode_*(key, payload)` returns a complete, valid message or raises Refusal, and no other exception.
"""

from bridge.wire.batches import (
    MAX_ACCEL,
    MAX_CELSIUS,
    MAX_RATE,
    MAX_SAMPLES,
    Rates,
    decode_corrected,
    decode_rates,
    decode_samples,
    encode_corrected,
    encode_samples,
)
from bridge.wire.cluster_messages import MAX_HOLDINGS, decode_checkpoint, decode_owned, encode_checkpoint, encode_owned
from bridge.wire.control_messages import (
    MAX_POINTS,
    decode_calibration,
    decode_command,
    decode_info,
    decode_note,
    decode_reply,
    decode_revision,
    decode_status,
    encode_calibration,
    encode_command,
    encode_info,
    encode_note,
    encode_reply,
    encode_revision,
    encode_status,
)
from bridge.wire.envelope import MAX_PAYLOAD
from bridge.wire.orientation import decode_orientation, encode_orientation
from bridge.wire.windows import MAX_WINDOWS, decode_windows, encode_windows

__all__ = [
    "MAX_ACCEL",
    "MAX_CELSIUS",
    "MAX_HOLDINGS",
    "MAX_PAYLOAD",
    "MAX_POINTS",
    "MAX_RATE",
    "MAX_SAMPLES",
    "MAX_WINDOWS",
    "Rates",
    "decode_calibration",
    "decode_checkpoint",
    "decode_command",
    "decode_corrected",
    "decode_info",
    "decode_note",
    "decode_orientation",
    "decode_owned",
    "decode_rates",
    "decode_reply",
    "decode_revision",
    "decode_samples",
    "decode_status",
    "decode_windows",
    "encode_calibration",
    "encode_checkpoint",
    "encode_command",
    "encode_corrected",
    "encode_info",
    "encode_note",
    "encode_orientation",
    "encode_owned",
    "encode_reply",
    "encode_revision",
    "encode_samples",
    "encode_status",
    "encode_windows",
]
