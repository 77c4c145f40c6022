"""Encoding and decoding of parts of messages: sentences, alerts, receipts and accelerometer calibrations."""

from collections.abc import Iterable, Sequence

from bridge.reasons.codes import Sentence, Sentences
from bridge.wire import truerate_pb2 as pb
from bridge.wire import validation
from bridge.wire.batches import MAX_RATE
from bridge.wire.messages import AccelerometerCalibration, Alert, Receipt, Verdict
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import MAX_NAME, MAX_SENTENCE, MAX_TEXTS, clean, text

_MAX_PARAMS = 8
#: most standing alerts of one device or estimator
MAX_ALERTS = 16
#: most receipts of one status
MAX_RECEIPTS = 16
#: largest NIS and test ratio, which stands for infinity too; largest standard deviation, rad/s
MAX_NIS, MAX_STD = 1e12, 1e6
_MOST_POSES = 1000
_MOST_BIAS, _MOST_SCALE, _MOST_VAR = 100.0, 10.0, 1e6


def encoded(sentences: Sentences) -> Iterable[pb.Sentence]:
    """Yield the first MAX_TEXTS sentences as protobuf messages.

    Parameter values are made printable, and shortened to the largest allowed length.
    """
    for code, params in sentences[:MAX_TEXTS]:
        values = {name: clean(value, MAX_SENTENCE) for name, value in params.items()}
        yield pb.Sentence(code=code, params=values)


def decoded(raw: Sequence[pb.Sentence], name: str) -> Sentences:
    """Validate and convert the sentences of a repeated protobuf field. name: the field, for error texts.

    Unknown codes are accepted, since a later version may send them.
    Raises Refusal for too many sentences or parameters, and for unprintable or long texts.
    """
    if len(raw) > MAX_TEXTS:
        raise Refusal(Reason.LENGTH, f"{name} has {len(raw)} sentences; at most {MAX_TEXTS} are allowed")
    return tuple(_decoded(one, name) for one in raw)


def _decoded(raw: pb.Sentence, name: str) -> Sentence:
    if len(raw.params) > _MAX_PARAMS:
        raise Refusal(Reason.LENGTH, f"{name} has {len(raw.params)} parameters; at most {_MAX_PARAMS} are allowed")
    code = text(raw.code, f"a code of {name}")
    params = {
        text(label, f"a parameter of {name}", MAX_NAME): text(value, f"{label} of {name}", MAX_SENTENCE)
        for label, value in raw.params.items()
    }
    return Sentence(code, params)


def alert_messages(alerts: Iterable[Alert]) -> list[pb.Alert]:
    """Convert standing alerts (raised, not yet cleared) to a list of protobuf messages.

    Names of persons are made printable, and shortened to the largest allowed length.
    """
    return [
        pb.Alert(
            kind=one.kind,
            since_ns=one.since_ns,
            raised_ns=one.raised_ns,
            acknowledged_ns=one.acknowledged_ns,
            who=clean(one.who, MAX_NAME),
        )
        for one in alerts
    ]


def alerts_in(raw: pb.Status | pb.Checkpoint | pb.Owned) -> tuple[Alert, ...]:
    """Validate the standing alerts (raised, not yet cleared) inside a received message and convert them.

    Raises Refusal for more than MAX_ALERTS alerts, and for an invalid alert.
    """
    if len(raw.alerts) > MAX_ALERTS:
        raise Refusal(Reason.LENGTH, f"alerts has {len(raw.alerts)} values; at most {MAX_ALERTS} are allowed")
    return tuple(
        Alert(
            text(one.kind, "kind"),
            validation.time_ns(one.since_ns, "since_ns"),
            validation.time_ns(one.raised_ns, "raised_ns"),
            validation.time_ns(one.acknowledged_ns, "acknowledged_ns"),
            text(one.who, "who"),
        )
        for one in raw.alerts
    )


def receipt_messages(receipts: Iterable[Receipt]) -> list[pb.Receipt]:
    """Convert receipts of the bias filter to a list of protobuf messages.

    A receipt describes one measurement update: innovation, test result, and whether the measurement was used.
    """
    return [pb.Receipt(**one._asdict()) for one in receipts]


def receipts_in(raw: pb.Status) -> tuple[Receipt, ...]:
    """Validate the receipts of the bias filter in a received status, and convert them to Receipt objects.

    A receipt describes one measurement update: innovation, test result, and whether the measurement was used.
    Raises Refusal for more than MAX_RECEIPTS receipts, and for an invalid receipt.
    """
    if len(raw.receipts) > MAX_RECEIPTS:
        raise Refusal(Reason.LENGTH, f"receipts has {len(raw.receipts)} values; at most {MAX_RECEIPTS} are allowed")
    return tuple(map(_receipt, raw.receipts))


def _receipt(raw: pb.Receipt) -> Receipt:
    if not 1 <= (n := len(raw.innovation)) <= 3:
        raise Refusal(Reason.LENGTH, f"innovation has {n} values; 1 to 3 are expected")
    return Receipt(
        validation.time_ns(raw.time_ns, "time_ns"),
        text(raw.kind, "kind"),
        tuple(validation.vector(raw.innovation, "innovation", n, -MAX_RATE, MAX_RATE).tolist()),
        tuple(validation.vector(raw.innovation_std, "innovation_std", n, 0.0, MAX_STD).tolist()),
        validation.number(raw.nis, "nis", 0.0, MAX_NIS),
        validation.number(raw.test_ratio, "test_ratio", 0.0, MAX_NIS),
        raw.accepted,
        text(raw.reason, "reason"),
    )


def accelerometer_message(one: AccelerometerCalibration | None) -> pb.AccelerometerCalibration | None:
    """Convert an accelerometer calibration to its protobuf message; returns None for None."""
    if one is None:
        return None
    return pb.AccelerometerCalibration(
        verdict=one.verdict,  # type: ignore[arg-type] # an int, whatever the stub says
        reason=encoded(one.reason),
        poses=one.poses,
        bias=one.bias,
        scale=one.scale,
        covariance=one.covariance,
        cross_std=one.cross_std,
    )


def accelerometer_in(raw: pb.Status | pb.Calibration) -> AccelerometerCalibration | None:
    """Validate the accelerometer calibration inside a received message and convert it.

    Returns None if the message has none. Raises Refusal if the calibration is invalid.
    """
    if not raw.HasField("accelerometer"):
        return None
    one = raw.accelerometer
    verdict = validation.member(Verdict, one.verdict, "verdict")
    n = 3 if verdict is Verdict.ACCEPTED else 0
    return AccelerometerCalibration(
        verdict,
        decoded(one.reason, "reason"),
        validation.whole(one.poses, "poses", _MOST_POSES),
        tuple(validation.vector(one.bias, "bias", n, -_MOST_BIAS, _MOST_BIAS).tolist()),
        tuple(validation.vector(one.scale, "scale", n, 0.0, _MOST_SCALE).tolist()),
        tuple(validation.vector(one.covariance, "covariance", 4 * n * n, -_MOST_VAR, _MOST_VAR).tolist()),
        validation.number(one.cross_std, "cross_std", 0.0, 1.0),
    )
