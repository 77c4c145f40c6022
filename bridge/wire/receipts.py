"""Encoding of the bias filter's receipts inside a status."""

from collections.abc import Iterable

from bridge.wire import truerate_pb2 as pb
from bridge.wire import validation
from bridge.wire.batches import MAX_RATE
from bridge.wire.messages import Receipt
from bridge.wire.refusal import Reason, Refusal

#: most receipts of one status
MAX_RECEIPTS = 16
#: largest NIS and test ratio, which stands for infinity too; largest standard deviation, rad/s
MAX_NIS, MAX_STD = 1e12, 1e6


def receipt_messages(receipts: Iterable[Receipt]) -> list[pb.Receipt]:
    """Convert the bias filter's receipts to a list of protobuf messages."""
    return [pb.Receipt(**one._asdict()) for one in receipts]


def receipts_in(raw: pb.Status) -> tuple[Receipt, ...]:
    """Validate the bias filter's receipts in a received status and convert them.

    Raises Refusal, also above MAX_RECEIPTS.
    """
    if len(raw.receipts) > MAX_RECEIPTS:
        raise Refusal(Reason.LENGTH, f"receipts has {len(raw.receipts)} values; at most {MAX_RECEIPTS} are allowed")
    return tuple(map(_receipt, raw.receipts))


def _receipt(raw: pb.Receipt) -> Receipt:
    if not 1 <= (n := len(raw.innovation)) <= 3:
        raise Refusal(Reason.LENGTH, f"innovation has {n} values; 1 to 3 are expected")
    return Receipt(
        validation.time_ns(raw.time_ns, "time_ns"),
        validation.text(raw.kind, "kind"),
        tuple(validation.vector(raw.innovation, "innovation", n, -MAX_RATE, MAX_RATE).tolist()),
        tuple(validation.vector(raw.innovation_std, "innovation_std", n, 0.0, MAX_STD).tolist()),
        validation.number(raw.nis, "nis", 0.0, MAX_NIS),
        validation.number(raw.test_ratio, "test_ratio", 0.0, MAX_NIS),
        raw.accepted,
        validation.text(raw.reason, "reason"),
    )
