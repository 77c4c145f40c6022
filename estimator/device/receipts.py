"""Conversion of the bias filter's receipts (records of its updates) into messages, within the wire format's range."""

import numpy as np

from bridge.wire import messages
from bridge.wire.batches import MAX_RATE
from bridge.wire.message_parts import MAX_NIS, MAX_STD
from estimator.tracking.evidence import Receipt


def receipt_message(receipt: Receipt, time_ns: int) -> messages.Receipt:
    """Convert a receipt of the bias filter (the record of one measurement update) into a wire message.

    time_ns: host time of the measurement, ns since the Unix epoch. Innovation and its standard deviation are in rad/s.
    A standard deviation, NIS or test ratio that is not finite becomes the largest of its range. An innovation of NaN
    becomes 0.
    """
    innovation = np.nan_to_num(receipt.innovation).clip(-MAX_RATE, MAX_RATE)
    std = np.nan_to_num(np.sqrt(receipt.innovation_cov.diagonal()), nan=MAX_STD).clip(0.0, MAX_STD)
    return messages.Receipt(
        time_ns,
        receipt.kind,
        tuple(innovation.tolist()),
        tuple(std.tolist()),
        _ratio(receipt.nis),
        _ratio(receipt.test_ratio),
        receipt.accepted,
        receipt.reason,
    )


def _ratio(value: float) -> float:
    return float(value) if 0.0 <= value <= MAX_NIS else MAX_NIS
