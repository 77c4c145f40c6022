"""Encoding of standing alerts inside other messages."""

from collections.abc import Iterable

from bridge.wire import truerate_pb2 as pb
from bridge.wire import validation
from bridge.wire.messages import Alert
from bridge.wire.refusal import Reason, Refusal

#: most standing alerts of one device or estimator
MAX_ALERTS = 16


def alert_messages(alerts: Iterable[Alert]) -> list[pb.Alert]:
    """Convert standing alerts to a list of protobuf messages; names are made printable and cut."""
    return [
        pb.Alert(
            kind=one.kind,
            since_ns=one.since_ns,
            raised_ns=one.raised_ns,
            acknowledged_ns=one.acknowledged_ns,
            who=validation.clean(one.who, validation.MAX_NAME),
        )
        for one in alerts
    ]


def alerts_in(raw: pb.Status | pb.Checkpoint | pb.Owned) -> tuple[Alert, ...]:
    """Validate the standing alerts inside a received message and convert them.

    Raises Refusal, also above MAX_ALERTS.
    """
    if len(raw.alerts) > MAX_ALERTS:
        raise Refusal(Reason.LENGTH, f"alerts has {len(raw.alerts)} values; at most {MAX_ALERTS} are allowed")
    return tuple(
        Alert(
            validation.text(one.kind, "kind"),
            validation.time_ns(one.since_ns, "since_ns"),
            validation.time_ns(one.raised_ns, "raised_ns"),
            validation.time_ns(one.acknowledged_ns, "acknowledged_ns"),
            validation.text(one.who, "who"),
        )
        for one in raw.alerts
    )
